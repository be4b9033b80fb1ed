#include "stridelab_native/lengths.hpp"

#include <cmath>

#include "stridelab_native/dense.hpp"
#include "stridelab_native/dynamics.hpp"

namespace stridelab {
namespace {

double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

void cross(const double* a, const double* b, double* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

constexpr double least_curve = 1e-2;  // in units of cost for a length that doubles

}  // namespace

void free_lengths(const Problem& problem, Iterate& it) {
  it.lengths.clear();
  it.free_intervals.assign(it.stages.size() - 1, FreeInterval{});
  std::size_t first = 0;
  for (const Phase& phase : problem.phases) {
    Length length{};
    length.first = first;
    length.intervals = static_cast<std::size_t>(phase.intervals);
    length.given = phase.h;
    length.h = it.stages[first].h;
    it.lengths.push_back(length);
    first += length.intervals;
  }
  it.nu_total = 0.0;
}

double differentiate_length(const Problem& problem, const Stage& s, FreeInterval& of) {
  const double h = s.h;
  const double* v = s.x + 3;
  const double* F = s.w;
  const double* T = s.w + 3;
  const double a[3] = {gravity * F[0], gravity * F[1], gravity * (F[2] - 1.0)};
  double swept[3];
  for (int i = 0; i < 3; ++i) {
    of.f[i] = v[i] + h * a[i];
    of.f[3 + i] = a[i];
    swept[i] = s.x[i] + h * v[i] + 0.5 * h * h * gravity * F[i];
  }
  of.f[6] = T[0] - swept[1];
  of.f[7] = T[1] + swept[0];
  of.f[8] = T[2];
  // costate^T x+
  const double* to_c = s.costate;
  const double* to_v = s.costate + 3;
  const double* to_K = s.costate + 6;
  const double turned[3] = {to_K[1], -to_K[0], 0.0};
  SecondDerivatives& more = of.more;
  more.curve = dot(to_c, a);
  for (int i = 0; i < 3; ++i) {
    more.curve += turned[i] * (v[i] + h * gravity * F[i]);
    more.q[i] = turned[i] + s.own[1 + i];
    more.q[3 + i] = to_c[i] + h * turned[i];
    more.r[i] = gravity * (h * to_c[i] + to_v[i] + 0.5 * h * h * turned[i]);
    more.r[3 + i] = to_K[i];
  }
  // h (w_c |a|^2 + w_L |l|^2),  l = T - m x F,  l_h = -m_h x F
  const double wc = problem.w_acceleration;
  const double wl = 2.0 * problem.w_momentum;
  const double* m = s.m;
  const double m_h[3] = {0.5 * v[0], 0.5 * v[1], 0.5 * v[2] - h / 3.0 * gravity};
  const double m_hh[3] = {0.0, 0.0, -gravity / 3.0};
  double l[3];
  double l_h[3];
  double l_hh[3];
  double lF[3];
  double l_hF[3];
  double ml[3];
  double ml_h[3];
  double m_hl[3];
  cross(m, F, l);
  cross(m_h, F, l_h);
  cross(m_hh, F, l_hh);
  for (int i = 0; i < 3; ++i) {
    l[i] = T[i] - l[i];
    l_h[i] = -l_h[i];
    l_hh[i] = -l_hh[i];
  }
  cross(l, F, lF);
  cross(l_h, F, l_hF);
  cross(m, l, ml);
  cross(m, l_h, ml_h);
  cross(m_h, l, m_hl);
  of.slope = wc * dot(a, a) + 0.5 * wl * dot(l, l) + h * wl * dot(l, l_h) + s.effort + s.own[0];
  // Gauss-Newton part of the squares of sqrt(h) a, sqrt(h) l and sqrt(h) u; `more` is the rest of the Hessian.
  SecondDerivatives& squared = of.squared;
  double l_s[3];
  double l_sF[3];
  double ml_s[3];
  for (int i = 0; i < 3; ++i) l_s[i] = h * l_h[i] + 0.5 * l[i];
  cross(l_s, F, l_sF);
  cross(m, l_s, ml_s);
  squared.curve = 0.5 * wc / h * dot(a, a) + wl / h * dot(l_s, l_s) + 0.5 * s.effort / h;
  more.curve += wl * (2.0 * dot(l, l_h) + h * (dot(l_h, l_h) + dot(l, l_hh))) - squared.curve;
  for (int i = 0; i < 3; ++i) {
    const double in_m = wl * (lF[i] + h * l_hF[i]);
    squared.q[i] = wl * l_sF[i];
    squared.q[3 + i] = 0.5 * h * wl * l_sF[i];
    squared.r[i] = wc * gravity * a[i] + wl * ml_s[i];
    squared.r[3 + i] = wl * l_s[i];
    more.q[i] += in_m - squared.q[i];
    more.q[3 + i] += 0.5 * h * (in_m + wl * lF[i]) - squared.q[3 + i];
    more.r[i] += 2.0 * wc * gravity * a[i] + wl * (ml[i] + h * (ml_h[i] + m_hl[i])) - squared.r[i];
    more.r[3 + i] += wl * (l[i] + h * l_h[i]) - squared.r[3 + i];
  }
  double slope = of.slope;
  for (int i = 0; i < nx; ++i) slope += s.costate[i] * of.f[i];
  return slope;
}

double total_length_error(const Problem& problem, const Iterate& it) {
  if (it.lengths.empty() || !std::isfinite(problem.length_limits.total)) return 0.0;
  double all = -problem.length_limits.total;
  for (const Length& l : it.lengths) all += static_cast<double>(l.intervals) * l.h;
  return all;
}

Columns columns(const Problem& problem, const Penalty& penalty) {
  Columns to{};
  if (std::isfinite(problem.length_limits.total)) to.C[1][1] = penalty.end;
  return to;
}

void enter(const Length& length, Columns& to) {
  for (int i = 0; i < nx; ++i) to.E[i][0] = i < 3 ? length.mixed[i] : 0.0;
  to.C[0][0] = to.C[0][1] = 0.0;
}

void approach(const Stage& s, FreeInterval& of, const double P[nx][nx], Columns& to) {
  of.pulled_by_gap[0] = of.pulled_by_gap[1] = 0.0;
  for (int i = 0; i < nx; ++i) {
    for (int j = 0; j < 2; ++j) of.pulled_by_gap[j] += to.E[i][j] * s.gap[i];
  }
  for (int i = 0; i < nx; ++i) {
    double Pf = 0.0;
    for (int j = 0; j < nx; ++j) Pf += P[i][j] * of.f[j];
    to.C[0][0] += of.f[i] * (2.0 * to.E[i][0] + Pf);
    to.C[0][1] += of.f[i] * to.E[i][1];
    to.E[i][0] += Pf;
  }
}

void pass(const Stage& s, FreeInterval& of, double theta, double drag, Columns& to) {
  for (int j = 0; j < 2; ++j) {
    double l[nx];
    double to_x[nx];
    double X[nw];
    double Y[nw];
    for (int i = 0; i < nx; ++i) l[i] = to.E[i][j];
    pull_back(s.h, l, to_x, X);
    for (int i = 0; j == 0 && i < nw; ++i) X[i] += of.squared.r[i] + theta * of.more.r[i];
    for (int i = 0; j == 0 && i < 6; ++i) to_x[i] += of.squared.q[i] + theta * of.more.q[i];
    for (int i = 0; i < nw; ++i) {
      Y[i] = j == 0 ? of.tau[i] : 0.0;
      for (int k = 0; k < nw; ++k) Y[i] += s.L[k][i] * X[k];
    }
    solve_lower(s.R, s.R_inverse, Y);
    for (int i = 0; i < nw; ++i) of.Y[i][j] = Y[i];
    for (int i = 0; i < nx; ++i) {
      to.E[i][j] = to_x[i];
      for (int k = 0; k < nw; ++k) to.E[i][j] -= s.Y[k][i] * Y[k];
    }
  }
  to.C[0][0] += of.squared.curve + theta * of.more.curve - drag;
  for (int i = 0; i < nw; ++i) {
    to.C[0][0] += of.tau[i] * of.tau[i] - of.Y[i][0] * of.Y[i][0];
    to.C[0][1] -= of.Y[i][0] * of.Y[i][1];
    to.C[1][1] -= of.Y[i][1] * of.Y[i][1];
  }
}

bool leave(Length& length, Columns& to, double P[nx][nx]) {
  const auto n = static_cast<double>(length.intervals);
  const double scale = 1.0 / (length.given * length.given);
  length.cross = to.C[0][1] + n * to.C[1][1];
  for (int i = 0; i < nx; ++i) length.E[i] = to.E[i][0] + n * to.E[i][1];
  length.pivot = to.C[0][0] + n * (2.0 * to.C[0][1] + n * to.C[1][1]) +
                 scale * (length.low.weight() + length.high.weight() + least_curve);
  if (!(length.pivot > 0.0)) return false;
  for (int i = 0; i < nx; ++i) {
    for (int j = 0; j < nx; ++j) P[i][j] -= length.E[i] * length.E[j] / length.pivot;
    to.E[i][1] -= length.E[i] * length.cross / length.pivot;
  }
  to.C[1][1] -= length.cross * length.cross / length.pivot;
  return true;
}

void approach(const FreeInterval& of, const double p[nx], double c[2]) {
  for (int i = 0; i < nx; ++i) c[0] += of.f[i] * p[i];
  for (int j = 0; j < 2; ++j) c[j] += of.pulled_by_gap[j];
}

void pass(const Stage& s, const FreeInterval& of, double drag, double c[2]) {
  c[0] += of.slope - drag;
  for (int i = 0; i < nw; ++i) {
    c[0] += of.tau[i] * s.tau[i] - of.Y[i][0] * s.kappa[i];
    c[1] -= of.Y[i][1] * s.kappa[i];
  }
}

void leave(Length& length, double p[nx], double c[2]) {
  const auto n = static_cast<double>(length.intervals);
  length.pull = c[0] + n * c[1] + (length.high.pull() - length.low.pull()) / length.given;
  for (int i = 0; i < nx; ++i) p[i] -= length.E[i] * length.pull / length.pivot;
  c[1] -= length.cross * length.pull / length.pivot;
}

double step_of(Length& length, const double dx[nx], double dt) {
  double t = length.pull + length.cross * dt;
  for (int i = 0; i < nx; ++i) t += length.E[i] * dx[i];
  length.dh = -t / length.pivot;
  const double by = length.dh / length.given;
  length.low.follow(-by);
  length.high.follow(by);
  return static_cast<double>(length.intervals) * length.dh;
}

}  // namespace stridelab
