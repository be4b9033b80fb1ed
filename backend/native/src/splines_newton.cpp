#include <algorithm>
#include <cmath>

#include "stridelab_native/dense.hpp"
#include "stridelab_native/dynamics.hpp"
#include "stridelab_native/forces.hpp"
#include "stridelab_native/splines.hpp"

namespace stridelab {
namespace {

// Columns of an interval: omega of w_2 and w_1+, which are eliminated, then x, omega of w_2- and of w_1, which remain.
constexpr int chosen = 2 * nw;
constexpr int kept = nx + 2 * nw;
constexpr int width = chosen + kept;
constexpr int padded = 40;
constexpr int at_x = chosen;
constexpr int column[4] = {at_x + nx, at_x + nx + nw, 0, nw};
constexpr int rows_of_all = nx + 3 * n_gauss;

constexpr int symmetric[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};

v8 load(const double* from) {
  v8 to;
  __builtin_memcpy(&to, from, sizeof to);
  return to;
}

void store(double* to, v8 from) { __builtin_memcpy(to, &from, sizeof from); }

// row += a other, from the block of eight with column `first` on.
void add(double* row, double a, const double* other, int first) {
  for (int j = first / 8 * 8; j < padded; j += 8) store(row + j, load(row + j) + a * load(other + j));
}

// The image of the columns in x+, and the Jacobian J of the momentum's squares, both in omega: J^T J is their
// curvature.
void image(const Basis& of, double h, const double* const (&L)[4], double (&G)[rows_of_all][padded]) {
  for (int i = 0; i < 3; ++i) {
    G[i][at_x + i] = G[3 + i][at_x + 3 + i] = G[6 + i][at_x + 6 + i] = 1.0;
    G[i][at_x + 3 + i] = h;
  }
  G[6][at_x + 1] = -h;
  G[7][at_x] = h;
  G[6][at_x + 4] = -0.5 * h * h;
  G[7][at_x + 3] = 0.5 * h * h;
  for (int j = 0; j < 4; ++j) {
    const double once = h * of.ends[0][j];
    const double twice = h * h * gravity * of.ends[1][j];
    const double thrice = h * h * h * gravity * of.ends[2][j];
    for (int i = 0; i < 3; ++i) {
      for (int a = 0; a < nw; ++a) {
        G[i][column[j] + a] = twice * L[j][8 * i + a];
        G[3 + i][column[j] + a] = gravity * once * L[j][8 * i + a];
        G[6 + i][column[j] + a] = once * L[j][8 * (3 + i) + a];
      }
    }
    for (int a = 0; a < nw; ++a) {
      G[6][column[j] + a] -= thrice * L[j][8 + a];
      G[7][column[j] + a] += thrice * L[j][a];
    }
  }
}

void momentum(const Problem& problem, const Stage& s, const double* const (&v)[4], const Basis& of,
              const double* const (&L)[4], double (&J)[rows_of_all][padded]) {
  const double h = 2.0 * s.h;
  for (int g = 0; g < n_gauss; ++g) {
    const double at = gauss_point(g);
    const double wl = std::sqrt(2.0 * h * gauss_weight(g) * problem.w_momentum);
    const Instant now = instant(of, g, h, s.x, v);
    const double* F = now.w;
    const double* c = now.c;
    const double Fx[3][3] = {{0, -F[2], F[1]}, {F[2], 0, -F[0]}, {-F[1], F[0], 0}};
    const double cx[3][3] = {{0, -c[2], c[1]}, {c[2], 0, -c[0]}, {-c[1], c[0], 0}};
    double (*row)[padded] = J + nx + 3 * g;
    for (int i = 0; i < 3; ++i) {
      for (int b = 0; b < 3; ++b) {
        row[i][at_x + b] = wl * Fx[i][b];
        row[i][at_x + 3 + b] = wl * h * at * Fx[i][b];
      }
      for (int j = 0; j < 4; ++j) {
        const double phi = wl * of.at[g][j];
        const double far = wl * h * h * gravity * of.twice[g][j];
        double to_F[3];
        for (int b = 0; b < 3; ++b) to_F[b] = far * Fx[i][b] - phi * cx[i][b];
        for (int a = 0; a < nw; ++a) {
          row[i][column[j] + a] =
              to_F[0] * L[j][a] + to_F[1] * L[j][8 + a] + to_F[2] * L[j][16 + a] + phi * L[j][8 * (3 + i) + a];
        }
      }
    }
  }
}

// Hessian of the squares of c'', which depend on forces only.
void acceleration(const Problem& problem, double h, const Basis& of, const double* const (&L)[4],
                  double (&H)[padded][padded]) {
  for (int j = 0; j < 4; ++j) {
    for (int l = 0; l < 4; ++l) {
      if (column[l] < column[j]) continue;
      double weight = 0.0;
      for (int g = 0; g < n_gauss; ++g) weight += gauss_weight(g) * of.at[g][j] * of.at[g][l];
      weight *= 2.0 * h * problem.w_acceleration * gravity * gravity;
      for (int a = 0; a < 3; ++a) {  // F is of the first three of omega
        for (int b = 0; b < 3; ++b) {
          double both = 0.0;
          for (int i = 0; i < 3; ++i) both += L[j][8 * i + a] * L[l][8 * i + b];
          H[column[j] + a][column[l] + b] += weight * both;
        }
      }
    }
  }
}

// H += G^T B, blocks of eight columns from that of the diagonal on, rows 8 first .. 8 first + 7.
template <int first>
void product(const double (&G)[rows_of_all][padded], const double (&B)[rows_of_all][padded],
             double (&H)[padded][padded]) {
  constexpr int blocks = padded / 8 - first;
  constexpr int end = first < 4 ? 8 * first + 8 : width;
  for (int i = 8 * first; i < end; i += 2) {
    v8 one[blocks];
    v8 two[blocks];
    for (int b = 0; b < blocks; ++b) {
      one[b] = load(&H[i][8 * (first + b)]);
      two[b] = load(&H[i + 1][8 * (first + b)]);
    }
    for (int r = 0; r < rows_of_all; ++r) {
      for (int b = 0; b < blocks; ++b) {
        const v8 other = load(&B[r][8 * (first + b)]);
        one[b] += G[r][i] * other;
        two[b] += G[r][i + 1] * other;
      }
    }
    for (int b = 0; b < blocks; ++b) {
      store(&H[i][8 * (first + b)], one[b]);
      store(&H[i + 1][8 * (first + b)], two[b]);
    }
  }
}

// Eliminate the given columns: stores R and Y in the spline and updates H.
bool eliminate(Spline& spline, double (&H)[padded][padded]) {
  for (int p = 0; p < chosen; ++p) {
    for (int q = 0; q < p; ++q) add(H[p], -H[q][p], H[q], p);
    if (!(H[p][p] > 0.0)) return false;
    spline.inverse[p] = 1.0 / std::sqrt(H[p][p]);
    for (int j = p / 8 * 8; j < padded; j += 8) store(H[p] + j, load(H[p] + j) * spline.inverse[p]);
    std::copy(H[p], H[p] + padded, spline.rows[p]);
  }
  for (int i = chosen; i < width; ++i) {
    for (int p = 0; p < chosen; ++p) add(H[i], -H[p][i], H[p], i);
  }
  return true;
}

// The first w_1, which is not the w_1+ of any interval: R of stage 0.
bool begin(Stage& s, const double (&P)[kept][kept]) {
  for (int i = 0; i < nw; ++i) {
    for (int j = 0; j < nw; ++j) s.R[i][j] = P[nx + nw + i][nx + nw + j];
    s.R[i][i] += 1.0;
  }
  return cholesky(s.R, s.R_inverse);
}

}  // namespace

bool factor_splines(const Problem& problem, Iterate& it, const Penalty& penalty, double theta) {
  constexpr double none[8 * nw] = {};
  const Ending end = ending(problem, it);
  double P[kept][kept] = {};
  double end_P[nx][nx];
  end_hessian(problem, it, end, penalty, theta >= 1.0, end_P);
  for (int i = 0; i < nx; ++i) std::copy(end_P[i], end_P[i] + nx, P[i]);
  for (std::size_t k = 0; k + 1 < it.stages.size(); ++k) root_of_forces(it, it.stages[k]);
  for (std::size_t k = it.splines.size(); k-- > 0;) {
    Spline& spline = it.splines[k];
    const Basis of = basis(spline);
    Stage& s = it.stages[2 * k];
    const double* L[4];
    const double* v[4];
    for (int j = 0; j < 4; ++j) {
      const Stage* stage = stage_of(it, k, j);
      L[j] = stage == nullptr ? none : &stage->L[0][0];
      v[j] = stage == nullptr ? none : stage->w;
    }
    for (int i = 0; i < kept; ++i) {
      spline.P_gap[i] = 0.0;
      for (int j = 0; j < nx; ++j) spline.P_gap[i] += P[j][i] * s.gap[j];
    }
    alignas(64) double G[rows_of_all][padded] = {};
    alignas(64) double B[rows_of_all][padded];
    alignas(64) double H[padded][padded] = {};
    image(of, 2.0 * s.h, L, G);
    momentum(problem, s, v, of, L, G);
    acceleration(problem, 2.0 * s.h, of, L, H);
    for (int r = nx; r < rows_of_all; ++r) std::copy(G[r], G[r] + padded, B[r]);
    // With P of (x+, chosen): G^T P_xx G, and G^T P_xc on either side.
    for (int i = 0; i < nx; ++i) {
      for (int j = 0; j < padded; ++j) B[i][j] = j < chosen ? P[i][nx + j] : 0.0;
      for (int r = 0; r < nx; ++r) add(B[i], P[i][r], G[r], 0);
    }
    for (int i = 0; i < chosen; ++i) {
      for (int j = i; j < chosen; ++j) H[i][j] += P[nx + i][nx + j];
      for (int r = 0; r < nx; ++r) add(H[i], P[r][nx + i], G[r], i);
      H[i][i] += 1.0;
    }
    product<0>(G, B, H);
    product<1>(G, B, H);
    product<2>(G, B, H);
    product<3>(G, B, H);
    product<4>(G, B, H);
    if (k + 1 == it.splines.size() && end.rests) {
      for (int a = 0; a < nw; ++a) {
        for (int b = a; b < nw; ++b) {
          for (int i = 0; i < 3; ++i) H[a][b] += penalty.rest * L[2][8 * i + a] * L[2][8 * i + b];
        }
      }
    }
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) {
        const int e = symmetric[i][j];
        H[at_x + i][at_x + j] += s.log_density.majoriser[e] - theta * s.log_density.covariance[e];
      }
    }
    if (s.bounded) H[at_x + 2][at_x + 2] += s.low.weight() + s.high.weight();
    if (!eliminate(spline, H)) return false;
    for (int i = 0; i < kept; ++i) {
      for (int j = i; j < kept; ++j) P[i][j] = P[j][i] = H[chosen + i][chosen + j];
    }
  }
  return begin(it.stages[0], P);
}

namespace {

// L^T y.
void turned(const Stage& s, const double (&y)[nw], double* out) {
  for (int a = 0; a < nw; ++a) {
    out[a] = 0.0;
    for (int i = 0; i < nw; ++i) out[a] += s.L[i][a] * y[i];
  }
}

// dw, du and dz of a stage from its omega.
void take(Iterate& it, Stage& s, const double* omega) {
  double all[nw];
  for (int i = 0; i < nw; ++i) {
    s.dw[i] = 0.0;
    for (int a = 0; a < nw; ++a) s.dw[i] += s.L[i][a] * omega[a];
    all[i] = omega[i] + s.tau[i];
  }
  follow(it, s, all, 0.0);
}

}  // namespace

void direct_splines(const Problem& problem, Iterate& it, const Penalty& penalty) {
  const std::size_t n = it.splines.size();
  const Ending end = ending(problem, it);
  double p[kept] = {};
  double end_p[nx];
  end_gradient(problem, it, end, penalty, end_p);
  std::copy(end_p, end_p + nx, p);
  for (std::size_t k = 0; k < 2 * n; ++k) condensed_gradient(it, it.stages[k], it.stages[k].tau);
  for (std::size_t k = n; k-- > 0;) {
    Spline& spline = it.splines[k];
    const Basis of = basis(spline);
    Stage& s = it.stages[2 * k];
    const double h = 2.0 * s.h;
    for (int i = 0; i < kept; ++i) p[i] += spline.P_gap[i];
    double g[width] = {};
    double to_x[nx];
    double unused[nw];
    pull_back(h, p, to_x, unused);
    for (int i = 0; i < nx; ++i) g[at_x + i] = s.q[i] + to_x[i];
    if (s.bounded) g[at_x + 2] += s.high.pull() - s.low.pull();
    for (int j = 0; j < 4; ++j) {
      const Stage* stage = stage_of(it, k, j);
      if (stage == nullptr) continue;
      double y[nw] = {};
      pull(of, j, h, p, y);
      if (j > 1) {
        for (int i = 0; i < nw; ++i) y[i] += stage->r[i];
      }
      if (j == 2 && k + 1 == n && end.rests) {
        for (int i = 0; i < 3; ++i) y[i] += it.nu_rest[i] + penalty.rest * end.rest[i];
      }
      turned(*stage, y, g + column[j]);
      if (j < 2) continue;
      for (int a = 0; a < nw; ++a) g[column[j] + a] += p[nx + column[j] + a] + stage->tau[a];
    }
    for (int i = 0; i < chosen; ++i) {
      double t = g[i];
      for (int q = 0; q < i; ++q) t -= spline.rows[q][i] * spline.kappa[q];
      spline.kappa[i] = t * spline.inverse[i];
    }
    for (int i = 0; i < kept; ++i) {
      p[i] = g[chosen + i];
      for (int q = 0; q < chosen; ++q) p[i] -= spline.rows[q][chosen + i] * spline.kappa[q];
    }
  }
  Stage& first = it.stages[0];
  double xi[kept] = {};
  double* omega = xi + nx + nw;
  double y[nw];
  std::copy(first.r, first.r + nw, y);
  turned(first, y, omega);
  for (int a = 0; a < nw; ++a) omega[a] = -(omega[a] + p[nx + nw + a] + first.tau[a]);
  solve_lower(first.R, first.R_inverse, omega);
  solve_upper(first.R, first.R_inverse, omega);
  take(it, first, omega);
  std::fill(first.dx, first.dx + nx, 0.0);
  for (std::size_t k = 0; k < n; ++k) {
    const Spline& spline = it.splines[k];
    Stage& s = it.stages[2 * k];
    if (s.bounded) {
      s.low.follow(-s.dx[2]);
      s.high.follow(s.dx[2]);
    }
    double found[chosen];
    for (int i = chosen; i-- > 0;) {
      double t = -spline.kappa[i];
      for (int q = 0; q < kept; ++q) t -= spline.rows[i][chosen + q] * xi[q];
      for (int q = i + 1; q < chosen; ++q) t -= spline.rows[i][q] * found[q];
      found[i] = t * spline.inverse[i];
    }
    take(it, it.stages[2 * k + 1], found);
    if (k + 1 < n) take(it, it.stages[2 * k + 2], found + nw);
    const Basis of = basis(spline);
    constexpr double none[nw] = {};
    double* next = it.stages[2 * k + 2].dx;
    advance_linear(2.0 * s.h, s.dx, none, next);
    for (int i = 0; i < nx; ++i) next[i] += s.gap[i];
    for (int j = 0; j < 4; ++j) {
      if (const Stage* stage = stage_of(it, k, j)) push(of, j, 2.0 * s.h, stage->dw, next);
    }
    std::copy(next, next + nx, xi);
    std::copy(found, found + chosen, xi + nx);
  }
  end_steps(problem, it);
}

}  // namespace stridelab
