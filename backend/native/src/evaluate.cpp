#include "stridelab_native/evaluate.hpp"

#include <algorithm>
#include <cmath>

#include "stridelab_native/dynamics.hpp"
#include "stridelab_native/ending.hpp"
#include "stridelab_native/hold.hpp"
#include "stridelab_native/lengths.hpp"
#include "stridelab_native/shifts.hpp"
#include "stridelab_native/splines.hpp"

namespace stridelab {
namespace {

double densities(const Problem& problem, const Phase& phase, double share, double h, Stage& s, double per_h[4],
                 Iterate& it, const Stage& of, bool ends) {
  double cost = 0.0;
  for (int i = 0; i < 3; ++i) per_h[1 + i] = -s.log_density.gradient[i];
  for (int i = 0; i < phase.visits; ++i) {
    const Visit& at = problem.visits[static_cast<std::size_t>(phase.first_visit + i)];
    const Density& density = problem.densities[static_cast<std::size_t>(at.density)];
    DensityDerivatives* log_density = at.moved < 0 ? nullptr : density_derivatives_of(it, of, at.moved, ends);
    if (log_density != nullptr) *log_density = DensityDerivatives{};
    cost += visit(at, density, s.x, problem.w_likelihood * share * h,
                  log_density == nullptr ? s.log_density : *log_density);
    if (log_density == nullptr) continue;
    for (int j = 0; j < 3; ++j) s.log_density.gradient[j] += log_density->gradient[j];
    for (int j = 0; j < 6; ++j) {
      s.log_density.majoriser[j] += log_density->majoriser[j];
      s.log_density.covariance[j] += log_density->covariance[j];
    }
  }
  per_h[0] = cost / h;
  for (int i = 0; i < 3; ++i) per_h[1 + i] = (per_h[1 + i] + s.log_density.gradient[i]) / h;
  return cost;
}

// (F, T) = sum of (S u, p x S u), and the effort.
double wrench(const Iterate& it, Stage& s) {
  v4 sums[nw] = {};
  double effort = 0.0;
  for (int b = 0; b < s.contact_blocks; ++b) {
    const ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)];
    const Block& block = *t.block;
    const v4* u = t.at.u;
    v4 f[3];
    for (int i = 0; i < 3; ++i) {
      f[i] = (block.S[3 * i] * u[0] + block.S[3 * i + 1] * u[1] + block.S[3 * i + 2] * u[2]) * block.real;
      sums[i] += f[i];
    }
    sums[3] += block.p[1] * f[2] - block.p[2] * f[1];
    sums[4] += block.p[2] * f[0] - block.p[0] * f[2];
    sums[5] += block.p[0] * f[1] - block.p[1] * f[0];
    effort += sum((block.effort[0] * (u[0] * u[0] + u[1] * u[1]) + block.effort[1] * u[2] * u[2]) * block.real);
  }
  for (int i = 0; i < nw; ++i) s.w[i] = sum(sums[i]);
  if (s.hold >= 0) {
    const WrenchControl& hold = it.wrench_controls[static_cast<std::size_t>(s.hold)];
    effort += hold.cone->effort * product(hold.at.u, hold.at.u);
    add_wrench(hold, hold.at.u, s.w);
  }
  s.effort = 0.5 * effort;
  return s.h * s.effort;
}

// h (w_c |c'' - a|^2 + w_L |(L_c+ - L_c) / h - r|^2) with its gradient, a the reference and r the limbs' rate.
double squares(const Problem& problem, Stage& s) {
  const double h = s.h;
  const double* F = s.w;
  const double* T = s.w + 3;
  for (int i = 0; i < 3; ++i) s.m[i] = s.x[i] + 0.5 * h * s.x[3 + i];
  s.m[2] -= h * h / 6.0 * gravity;
  const double a[3] = {gravity * F[0] - s.reference[0], gravity * F[1] - s.reference[1],
                       gravity * (F[2] - 1.0) - s.reference[2]};
  double* l = s.l;
  l[0] = T[0] - (s.m[1] * F[2] - s.m[2] * F[1]) - s.limbs[0];
  l[1] = T[1] - (s.m[2] * F[0] - s.m[0] * F[2]) - s.limbs[1];
  l[2] = T[2] - (s.m[0] * F[1] - s.m[1] * F[0]) - s.limbs[2];
  const double wc = 2.0 * h * problem.w_acceleration;
  const double wl = 2.0 * h * problem.w_momentum;
  const double g[3] = {wl * (l[1] * F[2] - l[2] * F[1]), wl * (l[2] * F[0] - l[0] * F[2]),
                       wl * (l[0] * F[1] - l[1] * F[0])};  // d/dm: -(l . dm x F) = dm . (l x F)
  for (int i = 0; i < 3; ++i) {
    s.q[i] = g[i];
    s.q[3 + i] = 0.5 * h * g[i];
    s.q[6 + i] = 0.0;
    s.r[3 + i] = wl * l[i];
  }
  s.r[0] = wc * gravity * a[0] - wl * (l[1] * s.m[2] - l[2] * s.m[1]);
  s.r[1] = wc * gravity * a[1] - wl * (l[2] * s.m[0] - l[0] * s.m[2]);
  s.r[2] = wc * gravity * a[2] - wl * (l[0] * s.m[1] - l[1] * s.m[0]);
  return 0.5 * (wc * (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]) + wl * (l[0] * l[0] + l[1] * l[1] + l[2] * l[2]));
}

// Residuals of the bounds.
void bounds(const Problem& problem, Iterate& it) {
  for (ContactBlock& t : it.contact_blocks) {
    if (t.load < 0) continue;
    Slack<v4>& load = it.loads[static_cast<std::size_t>(t.load)];
    load.r = t.at.u[2] + load.s - t.block->normal_max;
  }
  for (Stage& s : it.stages) {
    if (!s.bounded) continue;
    s.low.r = s.height[0] - s.x[2] + s.low.s;
    s.high.r = s.x[2] + s.high.s - s.height[1];
  }
  for (std::size_t a = 0; a < it.planes.size(); ++a) {
    it.planes[a].r = capture(problem.planes[a], it.stages.back().x) + it.planes[a].s - problem.planes[a].offset;
  }
  for (Length& l : it.lengths) {
    l.low.r = problem.length_limits.shortest - l.h / l.given + l.low.s;
    l.high.r = l.h / l.given + l.high.s - problem.length_limits.longest;
  }
}

// Slopes y and costates of all stages from the costate of the end.
void pull_all(const Problem& problem, Iterate& it, double costate[nx]) {
  if (problem.shape == Shape::cubic) return pull_splines(it, costate);
  for (std::size_t k = it.stages.size() - 1; k-- > 0;) {
    Stage& s = it.stages[k];
    std::copy(costate, costate + nx, s.costate);
    double to_x[nx];
    pull_back(s.h, costate, to_x, s.y);
    for (int i = 0; i < nw; ++i) s.y[i] += s.r[i];
    for (int i = 0; i < nx; ++i) costate[i] = s.q[i] + to_x[i];
    if (s.bounded) costate[2] += s.high.zeta - s.low.zeta;
  }
}

}  // namespace

double evaluate(const Problem& problem, Iterate& it) {
  double cost = 0.0;
  const std::size_t n = it.stages.size() - 1;
  const bool curved = problem.shape == Shape::cubic;
  const double nodes = curved ? 2.0 : 1.0;  // stages per node
  for (std::size_t k = 0; k <= n; ++k) {
    Stage& s = it.stages[k];
    s.log_density = DensityDerivatives{};
    if (curved) {
      if (k < n) cost += wrench(it, s);
      std::fill(s.q, s.q + nx, 0.0);
      std::fill(s.r, s.r + nw, 0.0);
      if (k % 2 == 1) continue;
    } else if (k < n) {
      cost += wrench(it, s) + squares(problem, s);
      advance(s.h, s.x, s.w, s.gap);
      for (int i = 0; i < nx; ++i) s.gap[i] -= it.stages[k + 1].x[i];
    } else {
      std::fill(s.q, s.q + nx, 0.0);
    }
    const Phase* before = k > 0 ? it.stages[k - 1].phase : nullptr;
    const bool first = s.phase != before;
    if (first && before != nullptr) {
      const Stage& of = it.stages[k - 1];
      cost += densities(problem, *before, 0.5 * nodes, of.h, s, s.before, it, of, true);
    }
    if (s.phase != nullptr) {
      cost += densities(problem, *s.phase, (first ? 0.5 : 1.0) * nodes, s.h, s, s.own, it, s, false);
    }
    for (int i = 0; i < 3; ++i) s.q[i] += s.log_density.gradient[i];
  }
  if (curved) cost += curved_squares(problem, it);
  for (Length& l : it.lengths) {
    const double* per_h = it.stages[l.first + l.intervals].before;
    const auto all = static_cast<double>(l.intervals);
    l.slope = per_h[0] + problem.length_limits.price * all;
    std::copy(per_h + 1, per_h + 4, l.mixed);
    cost += problem.length_limits.price * all * l.h;
  }
  bounds(problem, it);
  window_residuals(it);
  return cost;
}

double complementarity(const Iterate& it, int& cones) {
  double all = 0.0;
  cones = 0;
  each_cone(it, [&](const auto& t) {
    all += sum(product(t.at.u, t.at.z) * t.real());
    cones += static_cast<int>(sum(t.real()));
  });
  each_slack(it, [&](const auto& slack, auto real) {
    all += sum(slack.s * slack.zeta * real);
    cones += static_cast<int>(sum(real));
  });
  return all;
}

Conditions conditions(const Problem& problem, Iterate& it) {
  Conditions c{};
  const std::size_t n = it.stages.size() - 1;
  const Ending end = ending(problem, it);
  for (double e : end.miss) c.feasibility = std::max(c.feasibility, std::fabs(e));
  for (double e : end.rest) c.feasibility = std::max(c.feasibility, std::fabs(e));
  double costate[nx];
  end_costate(problem, it, end, costate);
  v4 worst = {};
  v4 most = {};
  v4 total = {};
  pull_all(problem, it, costate);
  for (int i = 0; end.rests && i < 3; ++i) it.stages[n - 1].y[i] += it.nu_rest[i];
  for (std::size_t k = n; k-- > 0;) {
    Stage& s = it.stages[k];
    const double* y = s.y;
    for (double missed : s.gap) c.feasibility = std::max(c.feasibility, std::fabs(missed));
    for (int b = 0; b < s.contact_blocks; ++b) {
      const ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)];
      const Block& block = *t.block;
      const v4 e[3] = {y[0] + y[4] * block.p[2] - y[5] * block.p[1], y[1] + y[5] * block.p[0] - y[3] * block.p[2],
                       y[2] + y[3] * block.p[1] - y[4] * block.p[0]};
      for (int i = 0; i < 3; ++i) {
        v4 slope = block.S[i] * e[0] + block.S[3 + i] * e[1] + block.S[6 + i] * e[2];
        slope += s.h * block.effort[i == 2] * t.at.u[i] - t.at.z[i];
        if (i == 2 && t.load >= 0) slope += it.loads[static_cast<std::size_t>(t.load)].zeta;
        worst = larger(worst, larger(slope, -slope) * block.real);
      }
      const v4 uz = product(t.at.u, t.at.z) * block.real;
      most = larger(most, uz);
      total += uz;
    }
    if (s.hold >= 0) {
      const WrenchControl& hold = it.wrench_controls[static_cast<std::size_t>(s.hold)];
      double slope[nw];
      pull_wrench(hold, y, slope);
      for (int i = 0; i < nw; ++i) {
        slope[i] += s.h * hold.cone->effort * hold.at.u[i] - hold.at.z[i];
        c.stationarity = std::max(c.stationarity, std::fabs(slope[i]));
      }
      const double uz = product(hold.at.u, hold.at.z);
      c.complementarity = std::max(c.complementarity, uz);
      c.gap += uz;
    }
  }
  c.feasibility = std::max(c.feasibility, std::fabs(total_length_error(problem, it)));
  for (const Length& l : it.lengths) {
    double slope = l.slope + (l.high.zeta - l.low.zeta) / l.given + it.nu_total * static_cast<double>(l.intervals);
    for (std::size_t k = l.first; k < l.first + l.intervals; ++k) {
      slope += differentiate_length(problem, it.stages[k], it.free_intervals[k]);
    }
    c.stationarity = std::max(c.stationarity, l.given * std::fabs(slope));
  }
  c.stationarity = std::max(c.stationarity, differentiate_shifts(problem, it));
  for (int i = 0; i < 4; ++i) {
    c.stationarity = std::max(c.stationarity, worst[i]);
    c.complementarity = std::max(c.complementarity, most[i]);
  }
  c.gap += sum(total);
  each_slack(it, [&](const auto& slack, auto real) {
    for (double missed : parts(slack.r * real)) c.feasibility = std::max(c.feasibility, std::fabs(missed));
    for (double left : parts(slack.s * slack.zeta * real)) c.complementarity = std::max(c.complementarity, left);
    c.gap += sum(slack.s * slack.zeta * real);
  });
  return c;
}

}  // namespace stridelab
