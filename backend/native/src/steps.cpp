#include "stridelab_native/steps.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "stridelab_native/dynamics.hpp"
#include "stridelab_native/evaluate.hpp"
#include "stridelab_native/lengths.hpp"
#include "stridelab_native/shifts.hpp"

namespace stridelab {

void set_targets(Iterate& it, double mu, bool corrected) {
  each_cone(it, [&](auto& t) {
    constexpr int n = std::extent_v<decltype(t.du)>;
    using T = std::remove_extent_t<decltype(t.du)>;
    T rc[n] = {};
    rc[n - 1] += mu;
    if (corrected) {
      T a[n];
      T b[n];
      unscale(t.scaling, t.du, a);
      scale(t.scaling, t.dz, b);
      for (int i = 0; i < n - 1; ++i) rc[i] -= a[n - 1] * b[i] + b[n - 1] * a[i];
      rc[n - 1] -= product(a, b);
    }
    T x[n];
    divide(t.scaling.lambda, rc, x);
    unscale(t.scaling, x, t.target);
  });
  each_slack(it, [&](auto& slack, auto) {
    slack.target = mu + 0.0 * slack.s;
    if (corrected) slack.target -= slack.ds * slack.dzeta;
  });
}

namespace {

template <typename T>
T longest_of(T s, T ds) {
  return ds < 0.0 ? -s / ds : 1e9 + 0.0 * s;
}

}  // namespace

Steps longest_steps(const Iterate& it) {
  Steps by{1e9, 1e9};
  each_cone(it, [&](const auto& t) {
    constexpr int n = std::extent_v<decltype(t.du)>;
    using T = std::remove_extent_t<std::remove_cvref_t<decltype(t.du)>>;
    const T far = T{} + 1e9;
    T a[n];
    T b[n];
    unscale(t.scaling, t.du, a);
    scale(t.scaling, t.dz, b);
    by.primal = std::min(by.primal, least(t.real() > 0.0 ? longest(t.scaling.lambda, a) : far));
    by.dual = std::min(by.dual, least(t.real() > 0.0 ? longest(t.scaling.lambda, b) : far));
  });
  each_slack(it, [&](const auto& slack, auto real) {
    by.primal = std::min(by.primal, least(real > 0.0 ? longest_of(slack.s, slack.ds) : 1e9 + 0.0 * slack.s));
    by.dual = std::min(by.dual, least(real > 0.0 ? longest_of(slack.zeta, slack.dzeta) : 1e9 + 0.0 * slack.s));
  });
  return by;
}

double complementarity_after(const Iterate& it, Steps by) {
  double all = 0.0;
  each_cone(it, [&](const auto& t) {
    constexpr int n = std::extent_v<decltype(t.du)>;
    std::remove_extent_t<std::remove_cvref_t<decltype(t.du)>> total = {};
    for (int i = 0; i < n; ++i) total += (t.at.u[i] + by.primal * t.du[i]) * (t.at.z[i] + by.dual * t.dz[i]);
    all += sum(total * t.real());
  });
  each_slack(it, [&](const auto& slack, auto real) {
    all += sum((slack.s + by.primal * slack.ds) * (slack.zeta + by.dual * slack.dzeta) * real);
  });
  return all;
}

void move(Iterate& it, Steps by) {
  for (Stage& s : it.stages) {
    for (int i = 0; i < nx; ++i) s.x[i] += by.primal * s.dx[i];
  }
  for (Length& l : it.lengths) {
    l.h += by.primal * l.dh;
    for (std::size_t k = l.first; k < l.first + l.intervals; ++k) it.stages[k].h = l.h;
  }
  for (Shift& s : it.shifts) {
    for (int i = 0; i < 2; ++i) s.d[i] += by.primal * s.step[i];
  }
  place_contacts(it);
  each_cone(it, [&](auto& t) {
    constexpr int n = std::extent_v<decltype(t.du)>;
    for (int i = 0; i < n; ++i) {
      t.at.u[i] += by.primal * t.du[i] * t.real();
      t.at.z[i] += by.dual * t.dz[i] * t.real();
    }
  });
  each_slack(it, [&](auto& slack, auto real) {
    slack.s += by.primal * slack.ds * real;
    slack.zeta += by.dual * slack.dzeta * real;
  });
}

Merit merit(const Problem& problem, const Iterate& it, double cost, double mu) {
  Merit m{cost, 0.0, 0.0};
  for (const Stage& s : it.stages) {
    for (int i = 0; i < nx; ++i) {
      m.violation += std::fabs(s.gap[i]);
      m.slope += s.q[i] * s.dx[i];
    }
    for (int i = 0; i < nw; ++i) m.slope += s.r[i] * s.dw[i];
    const auto barrier = [&](const auto& t) {
      constexpr int n = std::extent_v<decltype(t.du)>;
      const auto& u = t.at.u;
      const auto det = determinant(u);
      const auto inverse = mu / det;
      auto slope = (s.h * t.effort(n - 1) - inverse) * u[n - 1] * t.du[n - 1];
      for (int i = 0; i < n - 1; ++i) slope += (s.h * t.effort(i) + inverse) * u[i] * t.du[i];
      m.slope += sum(slope * t.real());
      for (double d : parts(t.real() > 0.0 ? det : 1.0 + 0.0 * det)) m.barrier -= 0.5 * mu * std::log(d);
    };
    for (int b = 0; b < s.contact_blocks; ++b) {
      barrier(it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)]);
    }
    if (s.hold >= 0) barrier(it.wrench_controls[static_cast<std::size_t>(s.hold)]);
  }
  each_slack(it, [&](const auto& slack, auto real) {
    m.slope -= sum(mu / slack.s * slack.ds * real);
    for (double s : parts(real > 0.0 ? slack.s : 1.0 + 0.0 * slack.s)) m.barrier -= mu * std::log(s);
    for (double r : parts(slack.r * real)) m.violation += std::fabs(r);
  });
  for (const Length& l : it.lengths) {
    m.slope += l.slope * l.dh;
    for (std::size_t k = l.first; k < l.first + l.intervals; ++k) m.slope += it.free_intervals[k].slope * l.dh;
  }
  m.slope += slope_of_shifts(it);
  m.violation += std::fabs(total_length_error(problem, it));
  const Ending end = ending(problem, it);
  for (double e : end.miss) m.violation += std::fabs(e);
  for (double e : end.rest) m.violation += std::fabs(e);
  return m;
}

double largest_gap(const Iterate& it) {
  double most = 0.0;
  for (const Stage& s : it.stages) {
    for (double gap : s.gap) most = std::max(most, std::fabs(gap));
  }
  return most;
}

void roll_out_states(Iterate& it) {
  for (std::size_t k = 0; k + 1 < it.stages.size(); ++k) {
    const Stage& s = it.stages[k];
    advance(s.h, s.x, s.w, it.stages[k + 1].x);
  }
}

void reset_multipliers(Iterate& it, double mu) {
  constexpr double far = 1e6;
  each_cone(it, [&](auto& t) {
    constexpr int n = std::extent_v<decltype(t.du)>;
    const auto uz = product(t.at.u, t.at.z);
    const auto share = mu / determinant(t.at.u);
    const auto kept = (uz > mu / far) & (uz < mu * far);
    for (int i = 0; i < n; ++i) t.at.z[i] = kept ? t.at.z[i] : (i == n - 1 ? share : -share) * t.at.u[i];
  });
}

}  // namespace stridelab
