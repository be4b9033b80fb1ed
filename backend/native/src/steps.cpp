#include "stridelab_native/steps.hpp"

#include <algorithm>
#include <cmath>

#include "stridelab_native/evaluate.hpp"

namespace stridelab {

void aim(Iterate& it, double mu, bool corrected) {
  for (Touch& t : it.touches) {
    v4 rc[3] = {splat4(0.0), splat4(0.0), splat4(mu)};
    if (corrected) {
      v4 a[3];
      v4 b[3];
      unscale(t.scaling, t.du, a);
      scale(t.scaling, t.dz, b);
      rc[0] -= a[2] * b[0] + b[2] * a[0];
      rc[1] -= a[2] * b[1] + b[2] * a[1];
      rc[2] -= product(a, b);
    }
    v4 x[3];
    divide(t.scaling.lambda, rc, x);
    unscale(t.scaling, x, t.target);
  }
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
  const v4 far = splat4(1e9);
  v4 primal = far;
  v4 dual = far;
  for (const Touch& t : it.touches) {
    v4 a[3];
    v4 b[3];
    unscale(t.scaling, t.du, a);
    scale(t.scaling, t.dz, b);
    primal = smaller(primal, t.block->real > 0.0 ? longest(t.scaling.lambda, a) : far);
    dual = smaller(dual, t.block->real > 0.0 ? longest(t.scaling.lambda, b) : far);
  }
  Steps by{least(primal), least(dual)};
  each_slack(it, [&](const auto& slack, auto real) {
    by.primal = std::min(by.primal, least(real > 0.0 ? longest_of(slack.s, slack.ds) : 1e9 + 0.0 * slack.s));
    by.dual = std::min(by.dual, least(real > 0.0 ? longest_of(slack.zeta, slack.dzeta) : 1e9 + 0.0 * slack.s));
  });
  return by;
}

double complementarity_after(const Iterate& it, Steps by) {
  v4 total = {};
  for (const Touch& t : it.touches) {
    v4 u[3];
    v4 z[3];
    for (int i = 0; i < 3; ++i) {
      u[i] = t.at.u[i] + by.primal * t.du[i];
      z[i] = t.at.z[i] + by.dual * t.dz[i];
    }
    total += product(u, z) * t.block->real;
  }
  double all = sum(total);
  each_slack(it, [&](const auto& slack, auto real) {
    all += sum((slack.s + by.primal * slack.ds) * (slack.zeta + by.dual * slack.dzeta) * real);
  });
  return all;
}

void move(Iterate& it, Steps by) {
  for (Stage& s : it.stages) {
    for (int i = 0; i < nx; ++i) s.x[i] += by.primal * s.dx[i];
  }
  for (Touch& t : it.touches) {
    for (int i = 0; i < 3; ++i) {
      t.at.u[i] += by.primal * t.du[i] * t.block->real;
      t.at.z[i] += by.dual * t.dz[i] * t.block->real;
    }
  }
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
    for (int b = 0; b < s.touches; ++b) {
      const Touch& t = it.touches[static_cast<std::size_t>(s.first_touch + b)];
      const v4* u = t.at.u;
      const v4 det = determinant(u);
      const v4 inverse = mu / det;
      v4 slope = (s.h * t.block->effort[1] - inverse) * u[2] * t.du[2];
      for (int i = 0; i < 2; ++i) slope += (s.h * t.block->effort[0] + inverse) * u[i] * t.du[i];
      m.slope += sum(slope * t.block->real);
      for (int j = 0; j < t.block->points; ++j) m.barrier -= 0.5 * mu * std::log(det[j]);
    }
  }
  each_slack(it, [&](const auto& slack, auto real) {
    m.slope -= sum(mu / slack.s * slack.ds * real);
    for (double s : parts(real > 0.0 ? slack.s : 1.0 + 0.0 * slack.s)) m.barrier -= mu * std::log(s);
    for (double r : parts(slack.r * real)) m.violation += std::fabs(r);
  });
  const Ending end = ending(problem, it);
  for (double e : end.miss) m.violation += std::fabs(e);
  for (double e : end.rest) m.violation += std::fabs(e);
  return m;
}

void tame(Iterate& it, double mu) {
  constexpr double far = 1e6;
  for (Touch& t : it.touches) {
    const v4 uz = product(t.at.u, t.at.z);
    for (int j = 0; j < 4; ++j) {
      if (uz[j] > mu / far && uz[j] < mu * far) continue;
      const double det = determinant(t.at.u)[j];
      t.at.z[0][j] = -mu * t.at.u[0][j] / det;
      t.at.z[1][j] = -mu * t.at.u[1][j] / det;
      t.at.z[2][j] = mu * t.at.u[2][j] / det;
    }
  }
}

}  // namespace stridelab
