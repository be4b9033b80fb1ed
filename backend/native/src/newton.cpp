#include "stridelab_native/newton.hpp"

#include <algorithm>

#include "stridelab_native/border.hpp"
#include "stridelab_native/costates.hpp"
#include "stridelab_native/dense.hpp"
#include "stridelab_native/dynamics.hpp"
#include "stridelab_native/evaluate.hpp"
#include "stridelab_native/forces.hpp"
#include "stridelab_native/hold.hpp"
#include "stridelab_native/lengths.hpp"
#include "stridelab_native/shifts.hpp"
#include "stridelab_native/splines.hpp"

namespace stridelab {
namespace {

// Gauss-Newton H of h w_c |c''|^2 + h w_L |l|^2 in (c, w), l = T - m x F; v follows c with h/2.
void curvature(const Problem& problem, const Stage& s, double twist, double cc[3][3], double cw[3][8],
               double ww[nw][8]) {
  const double wl = 2.0 * s.h * problem.w_momentum;
  const double wc = 2.0 * s.h * problem.w_acceleration * gravity * gravity;
  const double* F = s.w;
  const double* m = s.m;
  const double Fx[3][3] = {{0, -F[2], F[1]}, {F[2], 0, -F[0]}, {-F[1], F[0], 0}};
  const double mx[3][3] = {{0, -m[2], m[1]}, {m[2], 0, -m[0]}, {-m[1], m[0], 0}};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      double a = 0.0;
      double b = 0.0;
      double c = 0.0;
      for (int k = 0; k < 3; ++k) {
        a += Fx[k][i] * Fx[k][j];
        b -= Fx[k][i] * mx[k][j];
        c += mx[k][i] * mx[k][j];
      }
      cc[i][j] = wl * a;
      cw[i][j] = wl * b;
      cw[i][3 + j] = wl * Fx[j][i];
      ww[i][j] = wl * c + (i == j ? wc : 0.0);
      ww[i][3 + j] = -wl * mx[j][i];
      ww[3 + i][j] = -wl * mx[i][j];
      ww[3 + i][3 + j] = i == j ? wl : 0.0;
    }
    cw[i][6] = cw[i][7] = 0.0;
    ww[i][6] = ww[i][7] = ww[3 + i][6] = ww[3 + i][7] = 0.0;
  }
  for (int i = 0; i < 3; ++i) {  // l . d2 l, d2 l = -dm x dF
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    cw[j][k] -= twist * wl * s.l[i];
    cw[k][j] += twist * wl * s.l[i];
  }
}

constexpr int symmetric[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};

bool eliminate(const Problem& problem, Stage& s, double theta, double twist, double rest, double P[nx][nx]) {
  const double h = s.h;
  const double half = 0.5 * h * h;
  const double sixth = h * h * h / 6.0;
  double cc[3][3];
  double cw[3][8];
  double R[nw][8];
  curvature(problem, s, twist, cc, cw, R);
  for (int i = 0; i < 3; ++i) R[i][i] += rest;

  for (int i = 0; i < nx; ++i) {
    double t = 0.0;
    for (int j = 0; j < nx; ++j) t += P[i][j] * s.gap[j];
    s.P_gap[i] = t;
  }
  double PB[nx][8];
  for (int i = 0; i < nx; ++i) {
    for (int j = 0; j < 3; ++j) {
      PB[i][j] = gravity * (half * P[i][j] + h * P[i][3 + j]);
      PB[i][3 + j] = h * P[i][6 + j];
    }
    PB[i][0] += gravity * sixth * P[i][7];
    PB[i][1] -= gravity * sixth * P[i][6];
    PB[i][6] = PB[i][7] = 0.0;
  }
  // R += B^T P B
  for (int j = 0; j < 8; ++j) {
    for (int i = 0; i < 3; ++i) {
      R[i][j] += gravity * (half * PB[i][j] + h * PB[3 + i][j]);
      R[3 + i][j] += h * PB[6 + i][j];
    }
    R[0][j] += gravity * sixth * PB[7][j];
    R[1][j] -= gravity * sixth * PB[6][j];
  }
  // X = H_xw + A^T P B, in place
  for (int j = 0; j < 8; ++j) {
    for (int i = 0; i < 3; ++i) PB[3 + i][j] += h * PB[i][j] + 0.5 * h * cw[i][j];
    for (int i = 0; i < 3; ++i) PB[i][j] += cw[i][j];
    PB[0][j] += h * PB[7][j];
    PB[1][j] -= h * PB[6][j];
    PB[3][j] += half * PB[7][j];
    PB[4][j] -= half * PB[6][j];
  }
  // I + L^T R L and X L
  double RL[nw][8];
  for (int i = 0; i < nw; ++i) {
    for (int j = 0; j < 8; ++j) RL[i][j] = 0.0;
    for (int k = 0; k < nw; ++k) {
      for (int j = 0; j < 8; ++j) RL[i][j] += R[i][k] * s.L[k][j];
    }
  }
  for (int i = 0; i < nw; ++i) {
    for (int j = 0; j < 8; ++j) s.R[i][j] = 0.0;
    for (int k = s.hold < 0 ? i : 0; k < nw; ++k) {
      for (int j = 0; j < 8; ++j) s.R[i][j] += s.L[k][i] * RL[k][j];
    }
    s.R[i][i] += 1.0;
  }
  if (!cholesky(s.R, s.R_inverse)) return false;
  double XL[nx][8];
  for (int i = 0; i < nx; ++i) {
    for (int j = 0; j < 8; ++j) XL[i][j] = 0.0;
    for (int k = 0; k < nw; ++k) {
      for (int j = 0; j < 8; ++j) XL[i][j] += PB[i][k] * s.L[k][j];
    }
  }
  for (int i = 0; i < nw; ++i) {
    for (int j = 0; j < nx; ++j) s.Y[i][j] = XL[j][i];
    for (int k = 0; k < i; ++k) {
      for (int j = 0; j < nx; ++j) s.Y[i][j] -= s.R[i][k] * s.Y[k][j];
    }
    for (int j = 0; j < nx; ++j) s.Y[i][j] *= s.R_inverse[i];
  }
  // P := H_xx + A^T P A - Y^T Y
  for (int j = 0; j < nx; ++j) {
    for (int i = 0; i < 3; ++i) P[3 + i][j] += h * P[i][j];
    P[0][j] += h * P[7][j];
    P[1][j] -= h * P[6][j];
    P[3][j] += half * P[7][j];
    P[4][j] -= half * P[6][j];
  }
  for (int i = 0; i < nx; ++i) {
    for (int j = 0; j < 3; ++j) P[i][3 + j] += h * P[i][j];
    P[i][0] += h * P[i][7];
    P[i][1] -= h * P[i][6];
    P[i][3] += half * P[i][7];
    P[i][4] -= half * P[i][6];
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      const int e = symmetric[i][j];
      P[i][j] += cc[i][j] + s.log_density.majoriser[e] - theta * s.log_density.covariance[e];
      P[i][3 + j] += 0.5 * h * cc[i][j];
      P[3 + i][j] += 0.5 * h * cc[i][j];
      P[3 + i][3 + j] += 0.25 * h * h * cc[i][j];
    }
  }
  if (s.bounded) P[2][2] += s.low.weight() + s.high.weight();
  for (int k = 0; k < nw; ++k) {
    for (int i = 0; i < nx; ++i) {
      for (int j = 0; j < nx; ++j) P[i][j] -= s.Y[k][i] * s.Y[k][j];
    }
  }
  for (int i = 0; i < nx; ++i) {
    for (int j = 0; j < i; ++j) P[i][j] = P[j][i] = 0.5 * (P[i][j] + P[j][i]);
  }
  return true;
}

}  // namespace

void scale_cones(Iterate& it) {
  for (Stage& s : it.stages) {
    scale_forces(it, s);
    if (s.hold >= 0) scale(it.wrench_controls[static_cast<std::size_t>(s.hold)], s.h);
  }
}

bool factor(const Problem& problem, Iterate& it, const Penalty& penalty, Theta theta) {
  if (problem.shape == Shape::cubic) return factor_splines(problem, it, penalty, theta.densities);
  const std::size_t n = it.stages.size() - 1;
  const Ending end = ending(problem, it);
  double P[nx][nx];
  end_hessian(problem, it, end, penalty, theta.densities >= 1.0, P);
  it.theta = theta.densities;
  it.twist = theta.twist;
  it.effort_share = 0.5 * (1.0 + theta.lengths);
  it.pull_share = theta.lengths;
  Columns to = columns(problem, penalty);
  if (!it.shifts.empty()) begin_columns(it.border);
  for (std::size_t k = n; k-- > 0;) {
    Stage& s = it.stages[k];
    for (int i = 0; i < nw; ++i) s.L[i][6] = s.L[i][7] = 0.0;
    if (s.hold >= 0) {
      root_of(it.wrench_controls[static_cast<std::size_t>(s.hold)], s.L);
    } else {
      root_of_forces(it, s);
    }
    Length* length = length_of(problem, it, s);
    FreeInterval* stretched = length == nullptr ? nullptr : &it.free_intervals[k];
    if (stretched != nullptr) {
      if (k + 1 == length->first + length->intervals) enter(*length, to);
      approach(s, *stretched, P, to);
    }
    if (s.shift_uses > 0 && it.stages[k + 1].phase != s.phase) leave_phase(it, s, theta.densities);
    if (!it.shifts.empty()) approach(it, s, P);
    const double rest = k + 1 == n && end.rests ? penalty.rest : 0.0;
    if (!eliminate(problem, s, theta.densities, theta.twist, rest, P)) return false;
    if (stretched != nullptr) {
      double drag = condensed_effort_gradient(it, s, stretched->tau);
      for (double& t : stretched->tau) t *= it.effort_share;
      drag *= it.effort_share * it.effort_share;
      pass(s, *stretched, theta.lengths, drag, to);
      if (k == length->first && !leave(*length, to, P)) return false;
    }
    if (!it.shifts.empty()) pass_shift_uses(problem, it, k, theta.densities);
  }
  return it.shifts.empty() || factor_shifts(it);
}

void direction(const Problem& problem, Iterate& it, const Penalty& penalty) {
  if (problem.shape == Shape::cubic) return direct_splines(problem, it, penalty);
  const std::size_t n = it.stages.size() - 1;
  const Ending end = ending(problem, it);
  double p[nx];
  end_gradient(problem, it, end, penalty, p);
  double c[2] = {0.0, it.nu_total + penalty.end * total_length_error(problem, it)};
  if (!it.shifts.empty()) begin_slopes(it.border);
  for (std::size_t k = n; k-- > 0;) {
    Stage& s = it.stages[k];
    for (int i = 0; i < nx; ++i) p[i] += s.P_gap[i];
    if (!it.shifts.empty()) approach(it, s, p);
    Length* length = length_of(problem, it, s);
    const FreeInterval* stretched = length == nullptr ? nullptr : &it.free_intervals[k];
    if (stretched != nullptr) {
      if (k + 1 == length->first + length->intervals) c[0] = length->slope;
      approach(*stretched, p, c);
    }
    double to_x[nx];
    double r[nw];
    pull_back(s.h, p, to_x, r);
    for (int i = 0; i < nw; ++i) r[i] += s.r[i];
    if (k + 1 == n && end.rests) {
      for (int i = 0; i < 3; ++i) r[i] += it.nu_rest[i] + penalty.rest * end.rest[i];
    }
    double drag = 0.0;
    if (s.hold >= 0) {
      condensed_gradient(it.wrench_controls[static_cast<std::size_t>(s.hold)], s.h, s.tau);
    } else {
      drag = condensed_gradient(it, s, s.tau);
    }
    for (int i = 0; i < nw; ++i) {
      s.kappa[i] = s.tau[i];
      for (int j = s.hold < 0 ? i : 0; j < nw; ++j) s.kappa[i] += s.L[j][i] * r[j];
    }
    solve_lower(s.R, s.R_inverse, s.kappa);
    for (int j = 0; j < nx; ++j) {
      double t = s.q[j] + to_x[j];
      for (int i = 0; i < nw; ++i) t -= s.Y[i][j] * s.kappa[i];
      p[j] = t;
    }
    if (s.bounded) p[2] += s.high.pull() - s.low.pull();
    if (stretched != nullptr) {
      pass(s, *stretched, it.effort_share * drag, c);
      if (k == length->first) leave(*length, p, c);
    }
    if (!it.shifts.empty()) pass_slopes(it, k);
  }
  if (!it.shifts.empty()) step_shifts(it);
  std::fill(it.stages[0].dx, it.stages[0].dx + nx, 0.0);
  double dt = 0.0;
  for (std::size_t k = 0; k < n; ++k) {
    Stage& s = it.stages[k];
    Length* length = length_of(problem, it, s);
    const FreeInterval* stretched = length == nullptr ? nullptr : &it.free_intervals[k];
    if (stretched != nullptr && k == length->first) dt += step_of(*length, s.dx, dt);
    double omega[nw];
    for (int i = 0; i < nw; ++i) {
      double t = s.kappa[i];
      for (int j = 0; j < nx; ++j) t += s.Y[i][j] * s.dx[j];
      if (stretched != nullptr) t += stretched->Y[i][0] * length->dh + stretched->Y[i][1] * dt;
      omega[i] = t;
    }
    if (!it.shifts.empty()) add_columns(it, k, omega);
    for (double& o : omega) o = -o;
    solve_upper(s.R, s.R_inverse, omega);
    for (int i = 0; i < nw; ++i) {
      s.dw[i] = 0.0;
      for (int j = 0; j < nw; ++j) s.dw[i] += s.L[i][j] * omega[j];
    }
    double* next = it.stages[k + 1].dx;
    advance_linear(s.h, s.dx, s.dw, next);
    for (int i = 0; i < nx; ++i) next[i] += s.gap[i];
    for (int i = 0; stretched != nullptr && i < nx; ++i) next[i] += stretched->f[i] * length->dh;
    const Share* shares = shares_of(it, s);
    for (std::size_t a = 0; a < 2 * s.shift_uses; ++a) {
      for (int i = 6; i < nx; ++i) next[i] += shares[a].f[i] * it.border.step[shares[a].column];
    }
    if (s.bounded) {
      s.low.follow(-s.dx[2]);
      s.high.follow(s.dx[2]);
    }
    if (s.hold >= 0) {
      follow(it.wrench_controls[static_cast<std::size_t>(s.hold)], omega);
      continue;
    }
    for (int i = 0; i < nw; ++i) {
      omega[i] += s.tau[i];
      if (stretched != nullptr) omega[i] += stretched->tau[i] * length->dh;
      for (std::size_t a = 0; a < 2 * s.shift_uses; ++a) {
        omega[i] += shares[a].tau[i] * it.border.step[shares[a].column];
      }
    }
    follow(it, s, omega, stretched == nullptr ? 0.0 : it.effort_share * length->dh);
  }
  end_steps(problem, it);
  if (it.lengths.empty() && it.shifts.empty()) follow_costates(problem, it, end, penalty);
}

}  // namespace stridelab
