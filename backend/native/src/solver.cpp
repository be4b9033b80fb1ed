#include "stridelab_native/solver.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>

#include "stridelab_native/feasibility.hpp"
#include "stridelab_native/lengths.hpp"
#include "stridelab_native/shifts.hpp"
#include "stridelab_native/steps.hpp"

namespace stridelab {
namespace {

constexpr double to_the_boundary = 0.99;
constexpr double short_step = 0.05;          // below it a corrected step counts as failed
constexpr int exact_momentum_after = 15;     // iterations after which momenta have exact second derivatives
constexpr int feasibility_check_after = 60;  // iterations after which feasibility is checked
constexpr double feasible_below = 1e-6;      // residual below which the problem is feasible
constexpr int progress_window = 5;           // iterations over which the conditions must make progress
constexpr double progress = 0.999;
constexpr double armijo = 1e-4;
constexpr double end_tolerance =
    5e-4;  // of the tolerance: equations are linear and cost nothing; momenta are in units of m |g|
constexpr double gap_tolerance = 1e-11;  // larger gaps are moved to the end, by integrating the states
constexpr double acceptable = 20.0;      // times the tolerance, after `patience` iterations
constexpr int patience = 12;             // in which all other conditions hold
constexpr int halvings_max = 30;
// Tolerance, and gap as a share of the objective, at which lengths and contacts become variables.
constexpr double roughly = 1.0;
constexpr double freed_barrier = 0.3;
constexpr Penalty stiff{1e8, 1e6};
constexpr Penalty soft{1e5, 1e4};

double seconds_now() {
  std::timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double merit_of(const Conditions& c, double mu) {
  const double s = objective_scale * c.stationarity;
  return c.feasibility * c.feasibility + s * s + objective_scale * mu * objective_scale * mu;
}

class Run {
public:
  Run(const Problem& problem, Iterate& it, const Settings& settings)
      : problem_(problem), it_(it), settings_(settings) {}

  Report run() {
    const double began = seconds_now();
    if (bounded()) {
      evaluate(problem_, it_);
      initialise_slacks(it_, settings_.barrier);
    }
    cost_ = evaluate(problem_, it_);
    for (int i = 0;; ++i) {
      gap_ = complementarity(it_, cones_);
      mu_ = cones_ > 0 ? gap_ / cones_ : 0.0;
      Conditions c = conditions(problem_, it_);
      report_.conditions = c;
      report_.cost = cost_;
      report_.iterations = i;
      if (!std::isfinite(cost_ + c.stationarity + c.gap)) return ended(Verdict::not_finite);
      entry_ = Entry{cost_, c.feasibility, c.stationarity * objective_scale, mu_, 0.0, 0.0, 1.0, guarded_ ? 1.0 : 0.0};
      if (solved(c) && (led(c) || settled_ > progress_window)) return ended(Verdict::solved);
      if (i >= settings_.iterations) return ended(Verdict::out_of_iterations);
      if (seconds_now() - began > settings_.seconds) return ended(Verdict::out_of_time);
      watch(c);
      scale_cones(it_);
      if (!factored()) return ended(Verdict::stalled);
      if (!(guarded_ ? guarded_step() : free_step())) return ended(Verdict::stalled);
      report_.log.push_back(entry_);
    }
  }

private:
  Report ended(Verdict verdict) {
    report_.verdict = verdict;
    report_.log.push_back(entry_);
    return report_;
  }

  bool solved(const Conditions& c) {
    if (c.feasibility > end_tolerance * settings_.tolerance ||
        c.complementarity * objective_scale > settings_.tolerance || c.gap > gap_asked()) {
      return false;
    }
    // With large multipliers and almost active cones, stationarity is limited by rounding.
    const double asked = ++settled_ > patience ? acceptable : 1.0;
    return c.stationarity * objective_scale <= asked * settings_.tolerance;
  }

  // Whether the integrated states, which have no gaps, meet the end and all other conditions; they are used if so.
  bool led(Conditions& c) {
    if (problem_.shape == Shape::cubic || largest_gap(it_) <= gap_tolerance) return true;
    const std::vector<Stage> before = it_.stages;
    roll_out_states(it_);
    cost_ = evaluate(problem_, it_);
    c = conditions(problem_, it_);
    const double least = settled_ > patience ? acceptable * settings_.tolerance : settings_.tolerance;
    const double asked = std::max(least / objective_scale, report_.conditions.stationarity);
    const bool meets = c.feasibility <= end_tolerance * settings_.tolerance && c.stationarity <= asked;
    if (!meets) {
      it_.stages = before;
      c = conditions(problem_, it_);
      cost_ = report_.cost;
    }
    report_.cost = cost_;
    report_.conditions = c;
    return meets;
  }

  bool bounded() const {
    bool any = false;
    each_slack(it_, [&](const auto&, auto) { any = true; });
    return any;
  }

  double gap_asked() const { return settings_.gap * std::max(1.0, std::fabs(cost_)); }
  double mu_least() const { return 0.1 * gap_asked() / std::max(1, cones_); }

  // Progress of the conditions decides between free and guarded steps.
  void watch(const Conditions& c) {
    const double now = merit_of(c, mu_);
    if (guarded_) {
      const double held = objective_scale * held_mu_;
      const bool centred = c.feasibility <= 10.0 * held && c.stationarity * objective_scale <= 10.0 * held;
      if (centred || now < progress * *std::min_element(past_, past_ + progress_window)) {
        guarded_ = false;
        std::fill(past_, past_ + progress_window, now);
      }
      return;
    }
    const double worst = *std::max_element(past_, past_ + progress_window);
    if (now > progress * worst) {
      guarded_ = true;
      held_mu_ = std::max(mu_, mu_least());
      reset_multipliers(it_, held_mu_);
      return;
    }
    past_[at_] = now;
    at_ = (at_ + 1) % progress_window;
  }

  // The exact Hessian if the reduced Hessian is positive definite, otherwise reduced shares of it: first those of
  // lengths and of displacements with forces, then that of momenta, which is misleading far from a solution.
  bool factored() {
    for (const Penalty& penalty : {stiff, soft}) {
      penalty_ = penalty;
      entry_.theta = 1.0;
      const bool given = it_.lengths.empty() && it_.shifts.empty();
      if (!given && factor(problem_, it_, penalty_, Theta{1.0, 1.0})) return true;
      if (given && report_.iterations >= exact_momentum_after &&
          factor(problem_, it_, penalty_, Theta{1.0, 0.0, 1.0})) {
        return true;
      }
      for (double share : {1.0, 0.75, 0.5, 0.25, 0.0}) {
        entry_.theta = share;
        if (factor(problem_, it_, penalty_, Theta{share, 0.0})) return true;
      }
    }
    return false;
  }

  bool free_step() {
    set_targets(it_, 0.0, false);
    direction(problem_, it_, penalty_);
    Steps by = capped(longest_steps(it_), 1.0);
    const double ratio = gap_ > 0.0 ? complementarity_after(it_, by) / gap_ : 0.0;
    const double sigma = std::clamp(ratio * ratio * ratio, 1e-3, 1.0);
    set_targets(it_, std::max(sigma * mu_, mu_least()), true);
    direction(problem_, it_, penalty_);
    by = capped(longest_steps(it_), to_the_boundary);
    if (std::min(by.primal, by.dual) < short_step) {
      set_targets(it_, std::max(0.5 * mu_, mu_least()), false);
      direction(problem_, it_, penalty_);
      by = capped(longest_steps(it_), to_the_boundary);
    }
    accept(by);
    cost_ = evaluate(problem_, it_);
    return true;
  }

  // Newton step for a fixed barrier parameter, with sufficient decrease of the merit function.
  bool guarded_step() {
    set_targets(it_, held_mu_, false);
    direction(problem_, it_, penalty_);
    Steps by = capped(longest_steps(it_), to_the_boundary);
    const Merit at = merit(problem_, it_, cost_, held_mu_);
    if (at.violation > 0.0) weight_ = std::max(weight_, 2.0 * at.slope / at.violation);
    const double descent = at.slope - weight_ * at.violation;
    if (!(descent < 0.0)) return settle();
    move_multipliers(problem_, it_, penalty_, by.primal);
    move(it_, by);
    double step = by.primal;
    for (int i = 0;; ++i) {
      cost_ = evaluate(problem_, it_);
      const Merit there = merit(problem_, it_, cost_, held_mu_);
      const double gained = there.barrier + weight_ * there.violation - at.barrier - weight_ * at.violation;
      if (gained <= armijo * step * descent) break;
      if (i == halvings_max) return settle();
      move(it_, {-0.5 * step, 0.0});
      step *= 0.5;
    }
    reset_multipliers(it_, held_mu_);
    entry_.primal_step = step;
    entry_.dual_step = by.dual;
    return true;
  }

  // No progress at this barrier parameter: reduce it, if possible.
  bool settle() {
    if (held_mu_ <= mu_least()) return false;
    held_mu_ = std::max(0.1 * held_mu_, mu_least());
    cost_ = evaluate(problem_, it_);
    return true;
  }

  static Steps capped(Steps longest, double share) {
    return {std::min(1.0, share * longest.primal), std::min(1.0, share * longest.dual)};
  }

  void accept(Steps by) {
    move_multipliers(problem_, it_, penalty_, by.primal);
    move(it_, by);
    entry_.primal_step = by.primal;
    entry_.dual_step = by.dual;
  }

  const Problem& problem_;
  Iterate& it_;
  const Settings& settings_;
  Report report_;
  Entry entry_{};
  Penalty penalty_ = stiff;
  double cost_ = 0.0, gap_ = 0.0, mu_ = 0.0, held_mu_ = 0.0, weight_ = 0.0;
  double past_[progress_window] = {1e300, 1e300, 1e300, 1e300, 1e300};
  int at_ = 0, cones_ = 0, settled_ = 0;
  bool guarded_ = false;
};

}  // namespace

namespace {

Report joined(const Report& first, Report then) {
  then.iterations += first.iterations;
  then.log.insert(then.log.begin(), first.log.begin(), first.log.end());
  return then;
}

// Solve with fixed lengths.
Report solve_given(const Problem& problem, Iterate& it, const Settings& settings) {
  if (!settings.warm) cold_start(problem, it, settings.barrier);
  Settings at_first = settings;
  at_first.iterations = std::min(settings.iterations, feasibility_check_after);
  Report first = Run(problem, it, at_first).run();
  if (first.verdict == Verdict::solved || first.verdict == Verdict::out_of_time) return first;
  if (first.verdict == Verdict::out_of_iterations && first.conditions.feasibility < feasible_below) {
    // A feasible motion exists; only iterations are missing.
    Settings rest = settings;
    rest.iterations = settings.iterations - first.iterations;
    rest.warm = true;
    first = joined(first, Run(problem, it, rest).run());
    if (first.verdict == Verdict::solved || first.verdict == Verdict::out_of_time) return first;
  }
  Report report = feasibility(problem, it, settings);
  if (report.verdict == Verdict::solved) {
    Settings rest = settings;
    rest.iterations = std::max(1, settings.iterations - first.iterations);
    rest.barrier = 1.0;
    report = Run(problem, it, rest).run();
  }
  return joined(first, report);
}

}  // namespace

Report solve(const Problem& problem, Iterate& it, const Settings& settings) {
  const bool moves = !problem.places.empty();
  if (!problem.length_limits.lengths && !moves) return solve_given(problem, it, settings);
  const double began = seconds_now();
  Settings rough = settings;
  rough.tolerance = std::max(roughly, settings.tolerance);
  rough.gap = std::max(roughly, settings.gap);
  const Report given = solve_given(problem, it, rough);
  if (given.verdict != Verdict::solved) {
    cold_start(problem, it, settings.barrier);  // other lengths or placements may be feasible
  }
  Problem moved = problem;
  if (moves) {
    free_shifts(problem, moved, it);
  } else {
    free_lengths(problem, it);
  }
  int cones = 0;
  const double gap = complementarity(it, cones);
  Settings freed = settings;
  freed.barrier = std::max(freed_barrier, cones > 0 ? gap / cones : 0.0);
  freed.seconds = settings.seconds - (seconds_now() - began);
  const Report report = Run(moves ? moved : problem, it, freed).run();
  if (moves) release_shifts(problem, it);
  return joined(given, report);
}

}  // namespace stridelab
