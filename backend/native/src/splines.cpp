#include "stridelab_native/splines.hpp"

#include <algorithm>

#include "stridelab_native/dynamics.hpp"

namespace stridelab {
namespace {

constexpr double points[n_gauss] = {0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970263};
constexpr double shares[n_gauss] = {0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693};

// B_i of a degree at s.
constexpr double bernstein(int degree, int i, double s) {
  double value = 1.0;
  for (int k = 0; k < i; ++k) value *= s * (degree - k) / (k + 1.0);
  for (int k = i; k < degree; ++k) value *= 1.0 - s;
  return value;
}

struct Table {
  double at[n_gauss][4], twice[n_gauss][4];
  double ends[3][4];
};

constexpr Table tabled() {
  Table t{};
  for (int i = 0; i < 4; ++i) {
    for (int g = 0; g < n_gauss; ++g) {
      t.at[g][i] = bernstein(3, i, points[g]);
      for (int l = i + 2; l < 6; ++l) t.twice[g][i] += (l - i - 1) / 20.0 * bernstein(5, l, points[g]);
    }
    t.ends[0][i] = 0.25;
    t.ends[1][i] = (4 - i) / 20.0;
    t.ends[2][i] = (4 - i) * (5 - i) / 240.0;
  }
  return t;
}

constexpr Table table = tabled();

void mix(const double (&B)[4], const double (&own)[2], double (&phi)[4]) {
  phi[0] = (1.0 - own[0]) * B[0];
  phi[1] = own[0] * B[0] + B[1];
  phi[2] = B[2] + own[1] * B[3];
  phi[3] = (1.0 - own[1]) * B[3];
}

}  // namespace

double gauss_point(int g) { return points[g]; }
double gauss_weight(int g) { return shares[g]; }

Basis basis(const Spline& spline) {
  Basis b{};
  for (int g = 0; g < n_gauss; ++g) {
    mix(table.at[g], spline.own, b.at[g]);
    mix(table.twice[g], spline.own, b.twice[g]);
  }
  for (int n = 0; n < 3; ++n) mix(table.ends[n], spline.own, b.ends[n]);
  return b;
}

Instant instant(const Basis& of, int g, double h, const double* x, const double* const (&v)[4]) {
  Instant now{};
  const double t = h * points[g];
  for (int i = 0; i < 3; ++i) now.c[i] = x[i] + t * x[3 + i];
  now.c[2] -= 0.5 * t * t * gravity;
  for (int j = 0; j < 4; ++j) {
    for (int i = 0; i < nw; ++i) now.w[i] += of.at[g][j] * v[j][i];
    for (int i = 0; i < 3; ++i) now.c[i] += h * h * gravity * of.twice[g][j] * v[j][i];
  }
  return now;
}

void push(const Basis& of, int j, double h, const double* v, double* next) {
  const double once = h * of.ends[0][j];
  const double twice = h * h * gravity * of.ends[1][j];
  const double thrice = h * h * h * gravity * of.ends[2][j];
  for (int i = 0; i < 3; ++i) {
    next[i] += twice * v[i];
    next[3 + i] += gravity * once * v[i];
    next[6 + i] += once * v[3 + i];
  }
  next[6] -= thrice * v[1];
  next[7] += thrice * v[0];
}

void pull(const Basis& of, int j, double h, const double* l, double* y) {
  const double once = h * of.ends[0][j];
  const double twice = h * h * gravity * of.ends[1][j];
  const double thrice = h * h * h * gravity * of.ends[2][j];
  for (int i = 0; i < 3; ++i) {
    y[i] += twice * l[i] + gravity * once * l[3 + i];
    y[3 + i] += once * l[6 + i];
  }
  y[0] += thrice * l[7];
  y[1] -= thrice * l[6];
}

void join(Iterate& it) {
  const std::size_t n = it.stages.size() / 2;
  it.splines.assign(n, Spline{});
  for (std::size_t k = 0; k < n; ++k) {
    const double h = it.stages[2 * k].h;
    const double before = k > 0 ? it.stages[2 * k - 1].h : 1.0;
    const double after = k + 1 < n ? it.stages[2 * k + 2].h : 1.0;
    it.splines[k].own[0] = k > 0 ? before / (before + h) : 1.0;
    it.splines[k].own[1] = k + 1 < n ? after / (h + after) : 1.0;
  }
}

double curved_squares(const Problem& problem, Iterate& it) {
  constexpr double none[nw] = {};
  double cost = 0.0;
  for (std::size_t k = 0; k < it.splines.size(); ++k) {
    const Basis of = basis(it.splines[k]);
    Stage& s = it.stages[2 * k];
    const double h = 2.0 * s.h;
    Stage* stages[4];
    const double* v[4];
    for (int j = 0; j < 4; ++j) {
      stages[j] = stage_of(it, k, j);
      v[j] = stages[j] == nullptr ? none : stages[j]->w;
    }
    advance(h, s.x, none, s.gap);
    for (int j = 0; j < 4; ++j) push(of, j, h, v[j], s.gap);
    for (int i = 0; i < nx; ++i) s.gap[i] -= it.stages[2 * k + 2].x[i];
    for (int i = 0; i < 3; ++i) {
      s.m[i] = s.x[i] + h / 3.0 * s.x[3 + i];
      stages[2]->m[i] = s.x[i] + 2.0 * h / 3.0 * s.x[3 + i];
    }
    for (int g = 0; g < n_gauss; ++g) {
      const double at = points[g];
      const Instant now = instant(of, g, h, s.x, v);
      const double* w = now.w;
      const double* c = now.c;
      const double* F = w;
      const std::size_t row = 3 * (n_gauss * k + static_cast<std::size_t>(g));
      const double* reference = problem.reference.empty() ? none : &problem.reference[row];
      const double* limbs = problem.limbs.empty() ? none : &problem.limbs[row];
      const double a[3] = {gravity * F[0] - reference[0], gravity * F[1] - reference[1],
                           gravity * (F[2] - 1.0) - reference[2]};
      const double l[3] = {w[3] - (c[1] * F[2] - c[2] * F[1]) - limbs[0], w[4] - (c[2] * F[0] - c[0] * F[2]) - limbs[1],
                           w[5] - (c[0] * F[1] - c[1] * F[0]) - limbs[2]};
      const double wc = 2.0 * h * shares[g] * problem.w_acceleration;
      const double wl = 2.0 * h * shares[g] * problem.w_momentum;
      cost += 0.5 * (wc * (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]) + wl * (l[0] * l[0] + l[1] * l[1] + l[2] * l[2]));
      const double of_c[3] = {wl * (l[1] * F[2] - l[2] * F[1]), wl * (l[2] * F[0] - l[0] * F[2]),
                              wl * (l[0] * F[1] - l[1] * F[0])};
      const double of_F[3] = {wc * gravity * a[0] - wl * (l[1] * c[2] - l[2] * c[1]),
                              wc * gravity * a[1] - wl * (l[2] * c[0] - l[0] * c[2]),
                              wc * gravity * a[2] - wl * (l[0] * c[1] - l[1] * c[0])};
      for (int i = 0; i < 3; ++i) {
        s.q[i] += of_c[i];
        s.q[3 + i] += h * at * of_c[i];
        for (int j = 0; j < 4; ++j) {
          if (stages[j] == nullptr) continue;
          stages[j]->r[i] += of.at[g][j] * of_F[i] + h * h * gravity * of.twice[g][j] * of_c[i];
          stages[j]->r[3 + i] += of.at[g][j] * wl * l[i];
        }
      }
    }
  }
  return cost;
}

void pull_splines(Iterate& it, double costate[nx]) {
  const std::size_t n = it.splines.size();
  for (Stage& s : it.stages) std::copy(s.r, s.r + nw, s.y);
  for (std::size_t k = n; k-- > 0;) {
    const Basis of = basis(it.splines[k]);
    Stage& s = it.stages[2 * k];
    const double h = 2.0 * s.h;
    for (int j = 0; j < 4; ++j) {
      if (Stage* stage = stage_of(it, k, j)) pull(of, j, h, costate, stage->y);
    }
    double to_x[nx];
    double unused[nw];
    pull_back(h, costate, to_x, unused);
    for (int i = 0; i < nx; ++i) costate[i] = s.q[i] + to_x[i];
    if (s.bounded) costate[2] += s.high.zeta - s.low.zeta;
  }
}

}  // namespace stridelab
