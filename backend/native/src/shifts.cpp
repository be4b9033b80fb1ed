#include "stridelab_native/shifts.hpp"

#include <algorithm>
#include <cmath>

#include "stridelab_native/border.hpp"
#include "stridelab_native/forces.hpp"

namespace stridelab {
namespace {

constexpr int symmetric[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};

double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

void cross(const double* a, const double* b, double* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

// The curvature of -log p along an axis.
void along(const DensityDerivatives& log_density, double theta, const double* axis, double* out) {
  for (int i = 0; i < 3; ++i) {
    out[i] = 0.0;
    for (int j = 0; j < 3; ++j) {
      const int e = symmetric[i][j];
      out[i] += (log_density.majoriser[e] - theta * log_density.covariance[e]) * axis[j];
    }
  }
}

double width(const Shift& s, int i) { return s.place->high[i] - s.place->low[i]; }

// Stages and blocks on another problem of the same structure.
void rebind(const Problem& to, Iterate& it) {
  std::size_t k = 0;
  std::size_t slot = 0;
  for (const Phase& phase : to.phases) {
    for (int i = 0; i < phase.intervals; ++i, ++k) {
      it.stages[k].phase = &phase;
      for (int b = 0; b < phase.blocks; ++b) {
        it.contact_blocks[slot++].block = &to.blocks[static_cast<std::size_t>(phase.first_block + b)];
      }
    }
  }
}

}  // namespace

void free_shifts(const Problem& given, Problem& moved, Iterate& it) {
  it.given = &given;
  it.moved = &moved;
  rebind(moved, it);
  it.shifts.clear();
  it.shift_uses.clear();
  for (const Place& place : moved.places) {
    Shift shift{};
    shift.place = &place;
    it.shifts.push_back(shift);
  }
  for (Stage& s : it.stages) {
    s.first_shift_use = it.shift_uses.size();
    s.shift_uses = 0;
    s.columns = 2 * it.shifts.size();
    if (s.phase == nullptr) continue;
    const int phase = static_cast<int>(s.phase - moved.phases.data());
    for (std::size_t i = it.shifts.size(); i-- > 0;) {
      if (moved.places[i].last_phase >= phase) s.columns = 2 * i;
    }
    for (std::size_t i = 0; i < it.shifts.size(); ++i) {
      const Place& place = moved.places[i];
      if (place.first_phase > phase || place.last_phase < phase) continue;
      it.shift_uses.push_back(ShiftUse{});
      it.shift_uses.back().shift = i;
      ++s.shift_uses;
    }
  }
  it.shares.assign(2 * it.shift_uses.size(), Share{});
  for (std::size_t m = 0; m < it.shift_uses.size(); ++m) {
    for (std::size_t i = 0; i < 2; ++i) it.shares[2 * m + i].column = 2 * it.shift_uses[m].shift + i;
  }
  make_border(it, 2 * it.shifts.size());
}

void release_shifts(const Problem& given, Iterate& it) {
  rebind(given, it);
  for (std::size_t i = 0; i < it.shifts.size(); ++i) it.shifts[i].place = &given.places[i];
  it.given = nullptr;
  it.moved = nullptr;
}

void place_contacts(Iterate& it) {
  if (it.moved == nullptr) return;
  const auto shifted = [&](int place, int axis) {
    const Shift& s = it.shifts[static_cast<std::size_t>(place)];
    return s.place->axes[0][axis] * s.d[0] + s.place->axes[1][axis] * s.d[1];
  };
  for (std::size_t b = 0; b < it.moved->blocks.size(); ++b) {
    Block& block = it.moved->blocks[b];
    for (int i = 0; block.moved >= 0 && i < 3; ++i) block.p[i] = it.given->blocks[b].p[i] + shifted(block.moved, i);
  }
  for (std::size_t v = 0; v < it.moved->visits.size(); ++v) {
    Visit& at = it.moved->visits[v];
    for (int i = 0; at.moved >= 0 && i < 3; ++i) at.place[i] = it.given->visits[v].place[i] + shifted(at.moved, i);
  }
}

DensityDerivatives* density_derivatives_of(Iterate& it, const Stage& s, int place, bool ends) {
  for (std::size_t m = 0; m < s.shift_uses; ++m) {
    ShiftUse& of = it.shift_uses[s.first_shift_use + m];
    if (of.shift == static_cast<std::size_t>(place)) return ends ? &of.before : &of.own;
  }
  return nullptr;
}

void window_residuals(Iterate& it) {
  for (Shift& s : it.shifts) {
    for (int i = 0; i < 2; ++i) {
      s.low[i].r = (s.place->low[i] - s.d[i]) / width(s, i) + s.low[i].s;
      s.high[i].r = (s.d[i] - s.place->high[i]) / width(s, i) + s.high[i].s;
    }
  }
}

double differentiate_shifts(const Problem& problem, Iterate& it) {
  if (it.shifts.empty()) return 0.0;
  std::vector<double>& slopes = it.border.c;
  std::fill(slopes.begin(), slopes.end(), 0.0);
  for (std::size_t k = 0; k + 1 < it.stages.size(); ++k) {
    const Stage& s = it.stages[k];
    const bool ends = it.stages[k + 1].phase != s.phase;
    const double wl = 2.0 * s.h * problem.w_momentum;
    double worth[3];
    for (int i = 0; i < 3; ++i) worth[i] = s.r[3 + i] + s.h * s.costate[6 + i];
    for (std::size_t m = 0; m < s.shift_uses; ++m) {
      ShiftUse& use = it.shift_uses[s.first_shift_use + m];
      const Shift& shift = it.shifts[use.shift];
      double F[3];
      force_of(it, s, static_cast<int>(use.shift), F);
      for (std::size_t a = 0; a < 2; ++a) {
        const double* axis = shift.place->axes[a];
        Share& of = shares_of(it, s)[2 * m + a];
        double t[3];
        cross(axis, F, t);
        cross(worth, axis, use.pull[a]);
        double across[3];
        cross(s.m, t, across);
        of.slope = dot(s.r + 3, t) - dot(use.own.gradient, axis);
        if (ends) of.slope -= dot(use.before.gradient, axis);
        double slope = of.slope;
        for (int i = 0; i < 3; ++i) {
          of.f[6 + i] = s.h * t[i];
          of.r[i] = wl * across[i];
          of.r[3 + i] = wl * t[i];
          slope += s.costate[6 + i] * of.f[6 + i];
        }
        slopes[of.column] += slope;
      }
    }
  }
  double worst = 0.0;
  for (std::size_t j = 0; j < it.border.size; ++j) {
    const Shift& s = it.shifts[j / 2];
    const int i = static_cast<int>(j % 2);
    worst = std::max(worst, std::fabs(slopes[j] + (s.high[i].zeta - s.low[i].zeta) / width(s, i)));
  }
  return worst;
}

double slope_of_shifts(const Iterate& it) {
  double all = 0.0;
  for (const Share& of : it.shares) all += of.slope * it.border.step[of.column];
  return all;
}

void leave_phase(Iterate& it, const Stage& s, double theta) {
  Border& to = it.border;
  for (std::size_t m = 0; m < s.shift_uses; ++m) {
    const ShiftUse& use = it.shift_uses[s.first_shift_use + m];
    const auto& axes = it.shifts[use.shift].place->axes;
    for (std::size_t a = 0; a < 2; ++a) {
      double curve[3];
      along(use.before, theta, axes[a], curve);
      const std::size_t column = 2 * use.shift + a;
      for (std::size_t i = 0; i < 3; ++i) to.E[i * to.row + column] -= curve[i];
      for (std::size_t b = a; b < 2; ++b) to.C[column * to.row + column - a + b] += dot(curve, axes[b]);
    }
  }
}

void pass_shift_uses(const Problem& problem, Iterate& it, std::size_t k, double theta) {
  const Stage& s = it.stages[k];
  const double wl = 2.0 * s.h * problem.w_momentum;
  double curve[shares_max][shares_max] = {};
  Share* shares = shares_of(it, s);
  for (std::size_t m = 0; m < s.shift_uses; ++m) {
    const ShiftUse& use = it.shift_uses[s.first_shift_use + m];
    const auto& axes = it.shifts[use.shift].place->axes;
    for (std::size_t a = 0; a < 2; ++a) {
      Share& of = shares[2 * m + a];
      double curvature_along[3];
      double in_m[3];
      along(use.own, theta, axes[a], curvature_along);
      cross(of.f + 6, s.w, in_m);
      for (int i = 0; i < 3; ++i) {
        of.q[i] = wl / s.h * in_m[i] - curvature_along[i];
        of.q[3 + i] = 0.5 * wl * in_m[i];
      }
      for (std::size_t b = a; b < 2; ++b) curve[2 * m + a][2 * m + b] = dot(curvature_along, axes[b]);
      for (std::size_t b = 2 * m + a; b < 2 * s.shift_uses; ++b) {
        curve[2 * m + a][b] += wl / (s.h * s.h) * dot(of.f + 6, shares[b].f + 6);
      }
    }
    condensed_shift_gradient(it, s, use, shares + 2 * m, curve, 2 * m);
  }
  pass(it, k, curve);
}

void pass_slopes(Iterate& it, std::size_t k) {
  const Stage& s = it.stages[k];
  double drag[shares_max] = {};
  for (std::size_t m = 0; m < s.shift_uses; ++m) {
    drag_of_shift(it, s, it.shift_uses[s.first_shift_use + m], drag + 2 * m);
  }
  pass(it, k, drag);
}

bool factor_shifts(Iterate& it) {
  Border& b = it.border;
  const std::size_t n = b.size;
  b.root.assign(n * n, 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      double v = b.C[j * b.row + i];
      for (std::size_t l = 0; l < j; ++l) v -= b.root[i * n + l] * b.root[j * n + l];
      if (i > j) {
        b.root[i * n + j] = v / b.root[j * n + j];
        continue;
      }
      const Shift& s = it.shifts[i / 2];
      const int axis = static_cast<int>(i % 2);
      const double w = width(s, axis);
      v += (s.high[axis].weight() + s.low[axis].weight()) / (w * w);
      if (!(v > 0.0)) return false;
      b.root[i * n + i] = std::sqrt(v);
    }
  }
  return true;
}

void step_shifts(Iterate& it) {
  Border& b = it.border;
  const std::size_t n = b.size;
  for (std::size_t i = 0; i < n; ++i) {
    const Shift& s = it.shifts[i / 2];
    const int axis = static_cast<int>(i % 2);
    b.step[i] = -b.c[i] - (s.high[axis].pull() - s.low[axis].pull()) / width(s, axis);
    for (std::size_t l = 0; l < i; ++l) b.step[i] -= b.root[i * n + l] * b.step[l];
    b.step[i] /= b.root[i * n + i];
  }
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t l = i + 1; l < n; ++l) b.step[i] -= b.root[l * n + i] * b.step[l];
    b.step[i] /= b.root[i * n + i];
  }
  for (std::size_t j = 0; j < n; ++j) {
    Shift& s = it.shifts[j / 2];
    const int i = static_cast<int>(j % 2);
    s.step[i] = b.step[j];
    s.low[i].follow(-b.step[j] / width(s, i));
    s.high[i].follow(b.step[j] / width(s, i));
  }
}

}  // namespace stridelab
