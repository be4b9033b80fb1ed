#include "stridelab_native/feasibility.hpp"

#include <algorithm>
#include <cmath>

#include "stridelab_native/dynamics.hpp"
#include "stridelab_native/hold.hpp"
#include "stridelab_native/steps.hpp"

namespace stridelab {
namespace {

constexpr int iterations_max = 80;
constexpr Penalty elastic{1e6, 1e4};
constexpr double force_most = 10.0;  // the proof is valid for forces up to this many body weights on every point

struct Proof {
  bool wrench_controls;
  std::size_t stage;
};

// With y of all stages, the slopes along wrenches that `conditions` leaves: the problem has no cost.
Proof proof(const Problem& problem, const Iterate& it) {
  const Ending end = ending(problem, it);
  double size = 0.0;
  for (double v : it.nu) size += v * v;
  for (double v : it.nu_rest) size += v * v;
  for (const auto& plane : it.planes) size += plane.zeta * plane.zeta;
  size = std::sqrt(size);
  if (!(size > 0.0)) return {false, 0};
  const std::size_t n = it.stages.size() - 1;
  // Without forces.
  double x[nx];
  double next[nx];
  const double none[nw] = {};
  double value = end.rests ? -it.nu_rest[2] / size : 0.0;
  for (int i = 0; i < nx; ++i) x[i] = problem.start[static_cast<std::size_t>(i)];
  for (std::size_t k = 0; k < n; ++k) {
    const Stage& s = it.stages[k];
    if (s.bounded) {
      value += (s.low.zeta * (s.height[0] - x[2]) + s.high.zeta * (x[2] - s.height[1])) / size;
    }
    advance(s.h, x, none, next);
    std::copy(next, next + nx, x);
  }
  for (int r = 0; r < end.rows; ++r) {
    double miss = end.miss[r];
    for (int i = 0; i < nx; ++i) miss += end.J[r][i] * (x[i] - it.stages[n].x[i]);
    value += it.nu[r] / size * miss;
  }
  for (std::size_t a = 0; a < it.planes.size(); ++a) {
    value += it.planes[a].zeta / size * (capture(problem.planes[a], x) - problem.planes[a].offset);
  }
  // With forces.
  double lost = 0.0;
  double hardest = 1e-6;
  std::size_t where = n - 1;
  for (std::size_t k = n; k-- > 0;) {
    const Stage& s = it.stages[k];
    double y[nw];
    for (int i = 0; i < nw; ++i) y[i] = s.y[i] / size;
    double pull = 0.0;
    for (int b = 0; b < s.contact_blocks; ++b) {
      const Block& block = *it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)].block;
      const v4 e[3] = {y[0] + y[4] * block.p[2] - y[5] * block.p[1], y[1] + y[5] * block.p[0] - y[3] * block.p[2],
                       y[2] + y[3] * block.p[1] - y[4] * block.p[0]};
      v4 g[3];
      for (int i = 0; i < 3; ++i) g[i] = block.S[i] * e[0] + block.S[3 + i] * e[1] + block.S[6 + i] * e[2];
      const int load = it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)].load;
      if (load >= 0) {
        const v4 zeta = it.loads[static_cast<std::size_t>(load)].zeta / size;
        g[2] += zeta;
        value -= block.normal_max * sum(zeta * block.real);
      }
      const v4 outside = larger(root(g[0] * g[0] + g[1] * g[1]) - g[2], splat4(0.0)) * block.real;
      lost += force_most * sum(outside);
      pull += sum(larger(g[2], splat4(0.0)) * block.real);
    }
    if (s.hold >= 0) {
      double g[nw];
      pull_wrench(it.wrench_controls[static_cast<std::size_t>(s.hold)], y, g);
      lost += force_most * std::max(0.0, std::sqrt(across(g, g)) - g[nw - 1]);
      pull += std::max(0.0, g[nw - 1]);
    }
    if (pull > hardest) {
      hardest = pull;
      where = k;
    }
  }
  return {value > 0.0 && lost < 0.5 * value, where};
}

}  // namespace

Report feasibility(const Problem& problem, Iterate& it, const Settings& settings) {
  Problem least = problem;
  least.w_acceleration = least.w_momentum = least.w_likelihood = 0.0;
  if (least.end == End::capturable) least.end = End::upright;
  for (Block& b : least.blocks) b.effort[0] = b.effort[1] = 2.0;
  for (WrenchCone& cone : least.cones) cone.effort = 2.0;
  cold_start(least, it, 1.0);
  Report report;
  evaluate(least, it);
  initialise_slacks(it, 1.0);
  for (int i = 0;; ++i) {
    const double cost = evaluate(least, it);
    int cones = 0;
    const double gap = complementarity(it, cones);
    const Conditions c = conditions(least, it);
    report.iterations = i;
    report.conditions = c;
    report.cost = cost;
    if (!std::isfinite(cost + gap + c.stationarity)) {
      report.verdict = Verdict::not_finite;
      break;
    }
    report.log.push_back({cost, c.feasibility, c.stationarity * objective_scale, gap / std::max(1, cones), 0, 0, 0, 1});
    if (c.feasibility < settings.tolerance && gap < 1e-2 * std::max(1.0, cost)) {
      report.verdict = Verdict::solved;
      break;
    }
    if (i > 3 && c.feasibility > 0.1 * settings.tolerance) {
      const Proof found = proof(least, it);
      if (found.wrench_controls) {
        report.verdict = Verdict::infeasible;
        report.stage = found.stage;
        break;
      }
    }
    if (i == iterations_max) break;
    const double mu = cones > 0 ? gap / cones : 0.0;
    scale_cones(it);
    if (!factor(least, it, elastic, Theta{0.0, 0.0})) {
      report.verdict = Verdict::stalled;
      break;
    }
    set_targets(it, 0.0, false);
    direction(least, it, elastic);
    Steps by = longest_steps(it);
    by = {std::min(1.0, by.primal), std::min(1.0, by.dual)};
    const double ratio = gap > 0.0 ? complementarity_after(it, by) / gap : 0.0;
    // The barrier is kept until the end is met; otherwise the iterates would converge to an infeasible point.
    const double least_mu = std::min(0.1, c.feasibility);
    set_targets(it, std::max(least_mu, std::clamp(ratio * ratio * ratio, 1e-2, 1.0) * mu),
                std::min(by.primal, by.dual) > 0.1);
    direction(least, it, elastic);
    by = longest_steps(it);
    by = {std::min(1.0, 0.99 * by.primal), std::min(1.0, 0.99 * by.dual)};
    move_multipliers(least, it, elastic, by.dual);
    move(it, by);
  }
  // Start of the whole problem: its own blocks, multipliers of barrier parameter one.
  for (std::size_t k = 0; k + 1 < it.stages.size(); ++k) {
    Stage& s = it.stages[k];
    s.phase = &problem.phases[static_cast<std::size_t>(s.phase - least.phases.data())];
    for (int b = 0; b < s.contact_blocks; ++b) {
      ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)];
      t.block = &problem.blocks[static_cast<std::size_t>(t.block - least.blocks.data())];
    }
    if (s.hold < 0) continue;
    WrenchControl& hold = it.wrench_controls[static_cast<std::size_t>(s.hold)];
    hold.cone = &problem.cones[static_cast<std::size_t>(hold.cone - least.cones.data())];
  }
  std::fill(it.nu, it.nu + nx, 0.0);
  std::fill(it.nu_rest, it.nu_rest + 3, 0.0);
  return report;
}

}  // namespace stridelab
