#include "stridelab_native/newton.hpp"

#include <algorithm>

#include "stridelab_native/dense.hpp"
#include "stridelab_native/dynamics.hpp"
#include "stridelab_native/evaluate.hpp"

namespace stridelab {
namespace {

// S = sum G D^-1 G^T over the points of an interval, moments about m; lower triangle.
void condense(Iterate& it, const Stage& s, double S[nw][8]) {
  v4 sums[21] = {};
  for (int b = 0; b < s.touches; ++b) {
    const Touch& t = it.touches[static_cast<std::size_t>(s.first_touch + b)];
    const Block& block = *t.block;
    const double* R = block.S;
    const v4* I = t.D_inverse;
    v4 RI[3][3];
    for (int i = 0; i < 3; ++i) {
      RI[i][0] = R[3 * i] * I[0] + R[3 * i + 1] * I[1] + R[3 * i + 2] * I[2];
      RI[i][1] = R[3 * i] * I[1] + R[3 * i + 1] * I[3] + R[3 * i + 2] * I[4];
      RI[i][2] = R[3 * i] * I[2] + R[3 * i + 1] * I[4] + R[3 * i + 2] * I[5];
    }
    v4 M[3][3];  // compliance of a point in world axes
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j <= i; ++j) {
        M[i][j] = (RI[i][0] * R[3 * j] + RI[i][1] * R[3 * j + 1] + RI[i][2] * R[3 * j + 2]) * block.real;
        M[j][i] = M[i][j];
      }
    }
    const v4 p[3] = {block.p[0] - s.m[0], block.p[1] - s.m[1], block.p[2] - s.m[2]};
    v4 C[3][3];  // [p]x M
    for (int j = 0; j < 3; ++j) {
      C[0][j] = p[1] * M[2][j] - p[2] * M[1][j];
      C[1][j] = p[2] * M[0][j] - p[0] * M[2][j];
      C[2][j] = p[0] * M[1][j] - p[1] * M[0][j];
    }
    sums[0] += M[0][0];
    sums[1] += M[1][0];
    sums[2] += M[1][1];
    sums[3] += M[2][0];
    sums[4] += M[2][1];
    sums[5] += M[2][2];
    int at = 6;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) sums[at++] += C[i][j];
      // ([p]x M [p]x^T)_ij = (p x row_i(C))_j
      sums[at++] += p[1] * C[i][2] - p[2] * C[i][1];
      if (i > 0) sums[at++] += p[2] * C[i][0] - p[0] * C[i][2];
      if (i > 1) sums[at++] += p[0] * C[i][1] - p[1] * C[i][0];
    }
  }
  int at = 0;
  for (int i = 0; i < nw; ++i) {
    for (int j = 0; j <= i; ++j) S[i][j] = sum(sums[at++]);
  }
}

// sum G D^-1 g with g = h Q u - target.
void pulled(const Iterate& it, const Stage& s, double t[nw]) {
  v4 sums[nw] = {};
  for (int b = 0; b < s.touches; ++b) {
    const Touch& touch = it.touches[static_cast<std::size_t>(s.first_touch + b)];
    const Block& block = *touch.block;
    v4 g[3];
    v4 d[3];
    for (int i = 0; i < 3; ++i) g[i] = s.h * block.effort[i == 2] * touch.at.u[i] - touch.target[i];
    if (touch.load >= 0) g[2] += it.loads[static_cast<std::size_t>(touch.load)].pull();
    times(touch.D_inverse, g, d);
    v4 f[3];
    for (int i = 0; i < 3; ++i) {
      f[i] = (block.S[3 * i] * d[0] + block.S[3 * i + 1] * d[1] + block.S[3 * i + 2] * d[2]) * block.real;
      sums[i] += f[i];
    }
    sums[3] += block.p[1] * f[2] - block.p[2] * f[1];
    sums[4] += block.p[2] * f[0] - block.p[0] * f[2];
    sums[5] += block.p[0] * f[1] - block.p[1] * f[0];
  }
  for (int i = 0; i < nw; ++i) t[i] = sum(sums[i]);
}

// Gauss and Newton's H of h w_c |c''|^2 + h w_L |l|^2 in (c, w), l = T - m x F; v follows c with h/2.
void curvature(const Problem& problem, const Stage& s, double cc[3][3], double cw[3][8], double ww[nw][8]) {
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
}

constexpr int symmetric[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};

bool eliminate(const Problem& problem, Stage& s, double theta, double rest, double P[nx][nx]) {
  const double h = s.h;
  const double half = 0.5 * h * h;
  const double sixth = h * h * h / 6.0;
  double cc[3][3];
  double cw[3][8];
  double R[nw][8];
  curvature(problem, s, cc, cw, R);
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
    for (int k = i; k < nw; ++k) {
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
      P[i][j] += cc[i][j] + s.bend.majoriser[e] - theta * s.bend.covariance[e];
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
    for (int b = 0; b < s.touches; ++b) {
      Touch& t = it.touches[static_cast<std::size_t>(s.first_touch + b)];
      t.scaling = scaling(t.at);
      v4 D[6];
      inverse_square(t.scaling, D);
      D[0] += s.h * t.block->effort[0];
      D[3] += s.h * t.block->effort[0];
      D[5] += s.h * t.block->effort[1];
      if (t.load >= 0) D[5] += it.loads[static_cast<std::size_t>(t.load)].weight();
      invert(D, t.D_inverse);
    }
  }
}

bool factor(const Problem& problem, Iterate& it, const Penalty& penalty, double theta) {
  const std::size_t n = it.stages.size() - 1;
  const Ending end = ending(problem, it);
  double P[nx][nx];
  end_hessian(problem, it, end, penalty, theta >= 1.0, P);
  for (std::size_t k = n; k-- > 0;) {
    Stage& s = it.stages[k];
    double S[nw][8];
    condense(it, s, S);
    for (int i = 0; i < nw; ++i) s.L[i][6] = s.L[i][7] = 0.0;
    semidefinite_root(S, s.L, s.L_inverse);
    // Moments about the origin again: T + m x F. About a point far away, small pivots would be lost among large ones.
    for (int j = 0; j < 3; ++j) {
      s.L[3][j] += s.m[1] * s.L[2][j] - s.m[2] * s.L[1][j];
      s.L[4][j] += s.m[2] * s.L[0][j] - s.m[0] * s.L[2][j];
      s.L[5][j] += s.m[0] * s.L[1][j] - s.m[1] * s.L[0][j];
    }
    if (!eliminate(problem, s, theta, k + 1 == n && end.rests ? penalty.rest : 0.0, P)) return false;
  }
  return true;
}

void direction(const Problem& problem, Iterate& it, const Penalty& penalty) {
  const std::size_t n = it.stages.size() - 1;
  const Ending end = ending(problem, it);
  double p[nx];
  end_gradient(problem, it, end, penalty, p);
  for (std::size_t k = n; k-- > 0;) {
    Stage& s = it.stages[k];
    for (int i = 0; i < nx; ++i) p[i] += s.P_gap[i];
    double to_x[nx];
    double r[nw];
    pull_back(s.h, p, to_x, r);
    for (int i = 0; i < nw; ++i) r[i] += s.r[i];
    if (k + 1 == n && end.rests) {
      for (int i = 0; i < 3; ++i) r[i] += it.nu_rest[i] + penalty.rest * end.rest[i];
    }
    pulled(it, s, s.tau);
    solve_lower(s.L, s.L_inverse, s.tau);
    for (int i = 0; i < nw; ++i) {
      s.kappa[i] = s.tau[i];
      for (int j = i; j < nw; ++j) s.kappa[i] += s.L[j][i] * r[j];
    }
    solve_lower(s.R, s.R_inverse, s.kappa);
    for (int j = 0; j < nx; ++j) {
      double t = s.q[j] + to_x[j];
      for (int i = 0; i < nw; ++i) t -= s.Y[i][j] * s.kappa[i];
      p[j] = t;
    }
    if (s.bounded) p[2] += s.high.pull() - s.low.pull();
  }
  std::fill(it.stages[0].dx, it.stages[0].dx + nx, 0.0);
  for (std::size_t k = 0; k < n; ++k) {
    Stage& s = it.stages[k];
    double omega[nw];
    for (int i = 0; i < nw; ++i) {
      double t = s.kappa[i];
      for (int j = 0; j < nx; ++j) t += s.Y[i][j] * s.dx[j];
      omega[i] = -t;
    }
    solve_upper(s.R, s.R_inverse, omega);
    for (int i = 0; i < nw; ++i) {
      s.dw[i] = 0.0;
      for (int j = 0; j <= i; ++j) s.dw[i] += s.L[i][j] * omega[j];
    }
    double* next = it.stages[k + 1].dx;
    advance_linear(s.h, s.dx, s.dw, next);
    for (int i = 0; i < nx; ++i) next[i] += s.gap[i];
    if (s.bounded) {
      s.low.follow(-s.dx[2]);
      s.high.follow(s.dx[2]);
    }
    double y[nw];
    for (int i = 0; i < nw; ++i) y[i] = omega[i] + s.tau[i];
    solve_upper(s.L, s.L_inverse, y);
    for (int b = 0; b < s.touches; ++b) {
      Touch& t = it.touches[static_cast<std::size_t>(s.first_touch + b)];
      const Block& block = *t.block;
      const v4 e[3] = {y[0] + y[4] * block.p[2] - y[5] * block.p[1], y[1] + y[5] * block.p[0] - y[3] * block.p[2],
                       y[2] + y[3] * block.p[1] - y[4] * block.p[0]};
      v4 g[3];
      for (int i = 0; i < 3; ++i) {
        g[i] = block.S[i] * e[0] + block.S[3 + i] * e[1] + block.S[6 + i] * e[2];
        g[i] += t.target[i] - s.h * block.effort[i == 2] * t.at.u[i];
      }
      if (t.load >= 0) g[2] -= it.loads[static_cast<std::size_t>(t.load)].pull();
      times(t.D_inverse, g, t.du);
      if (t.load >= 0) it.loads[static_cast<std::size_t>(t.load)].follow(t.du[2]);
      v4 E[6];
      inverse_square(t.scaling, E);
      times(E, t.du, t.dz);
      for (int i = 0; i < 3; ++i) t.dz[i] = t.target[i] - t.at.z[i] - t.dz[i];
    }
  }
  end_steps(problem, it);
}

}  // namespace stridelab
