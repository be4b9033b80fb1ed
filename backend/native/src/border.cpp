#include "stridelab_native/border.hpp"

#include <algorithm>

namespace stridelab {
namespace {

constexpr std::size_t width = 4;  // columns are padded to groups of this size

std::size_t first_of(const Stage& s) { return s.columns - s.columns % width; }

}  // namespace

void make_border(Iterate& it, std::size_t size) {
  Border& b = it.border;
  b.size = size;
  b.row = (size + width - 1) / width * width;
  b.E.assign(nx * b.row, 0.0);
  b.C.assign(b.row * b.row, 0.0);
  b.Y.assign((it.stages.size() - 1) * nw * b.row, 0.0);
  b.by_gap.assign(b.row, 0.0);
  b.c.assign(b.row, 0.0);
  b.step.assign(b.row, 0.0);
}

void begin_columns(Border& border) {
  std::fill(border.E.begin(), border.E.end(), 0.0);
  std::fill(border.C.begin(), border.C.end(), 0.0);
  std::fill(border.by_gap.begin(), border.by_gap.end(), 0.0);
}

void approach(Iterate& it, const Stage& s, const double P[nx][nx]) {
  Border& to = it.border;
  const std::size_t row = to.row;
  const std::size_t first = first_of(s);
  double* E = to.E.data();
  for (int i = 0; i < nx; ++i) {
    for (std::size_t j = first; j < row; ++j) to.by_gap[j] += E[static_cast<std::size_t>(i) * row + j] * s.gap[i];
  }
  const Share* shares = shares_of(it, s);
  for (std::size_t a = 0; a < 2 * s.shift_uses; ++a) {
    const Share& of = shares[a];
    const std::size_t own = of.column;
    double Pf[nx];
    double* C = to.C.data();
    double fE = 0.0;
    double fPf = 0.0;
    for (int i = 0; i < nx; ++i) {
      Pf[i] = 0.0;
      for (int j = 0; j < nx; ++j) Pf[i] += P[i][j] * of.f[j];
      const double* Ei = E + static_cast<std::size_t>(i) * row;
      fE += of.f[i] * Ei[own];
      fPf += of.f[i] * Pf[i];
      for (std::size_t j = first; j < own; ++j) C[j * row + own] += of.f[i] * Ei[j];
      for (std::size_t j = own + 1; j < row; ++j) C[own * row + j] += of.f[i] * Ei[j];
    }
    C[own * row + own] += 2.0 * fE + fPf;
    for (int i = 0; i < nx; ++i) E[static_cast<std::size_t>(i) * row + own] += Pf[i];
  }
}

void pass(Iterate& it, std::size_t k, const double curve[shares_max][shares_max]) {
  const Stage& s = it.stages[k];
  Border& to = it.border;
  const std::size_t row = to.row;
  const std::size_t first = first_of(s);
  double* E = to.E.data();
  double* Y = to.Y.data() + k * nw * row;
  const Share* shares = shares_of(it, s);
  const double h = s.h;
  const double half = 0.5 * h * h;
  const double sixth = h * h * h / 6.0;
  // H_w + B^T E, and H_x + A^T E in place.
  double X[nw][width];
  for (std::size_t at = first; at < row; at += width) {
    double* e[nx];
    for (int i = 0; i < nx; ++i) e[i] = E + static_cast<std::size_t>(i) * row + at;
    for (std::size_t j = 0; j < width; ++j) {
      for (int i = 0; i < 3; ++i) {
        X[i][j] = gravity * (half * e[i][j] + h * e[3 + i][j]);
        X[3 + i][j] = h * e[6 + i][j];
      }
      X[0][j] += gravity * sixth * e[7][j];
      X[1][j] -= gravity * sixth * e[6][j];
      for (int i = 0; i < 3; ++i) e[3 + i][j] += h * e[i][j];
      e[0][j] += h * e[7][j];
      e[1][j] -= h * e[6][j];
      e[3][j] += half * e[7][j];
      e[4][j] -= half * e[6][j];
    }
    double T[nw][width] = {};
    for (std::size_t a = 0; a < 2 * s.shift_uses; ++a) {
      const Share& of = shares[a];
      if (of.column < at || of.column >= at + width) continue;
      const std::size_t j = of.column - at;
      for (int i = 0; i < nw; ++i) X[i][j] += of.r[i];
      for (int i = 0; i < 6; ++i) e[i][j] += of.q[i];
      for (int i = 0; i < nw; ++i) T[i][j] = of.tau[i];
    }
    // Y = R^-1 (tau + L^T X)
    for (int i = 0; i < nw; ++i) {
      for (int l = 0; l < nw; ++l) {
        for (std::size_t j = 0; j < width; ++j) T[i][j] += s.L[l][i] * X[l][j];
      }
      for (int l = 0; l < i; ++l) {
        for (std::size_t j = 0; j < width; ++j) T[i][j] -= s.R[i][l] * T[l][j];
      }
      double* y = Y + static_cast<std::size_t>(i) * row + at;
      for (std::size_t j = 0; j < width; ++j) {
        T[i][j] *= s.R_inverse[i];
        y[j] = T[i][j];
      }
    }
    for (int i = 0; i < nx; ++i) {
      for (int l = 0; l < nw; ++l) {
        for (std::size_t j = 0; j < width; ++j) e[i][j] -= s.Y[l][i] * T[l][j];
      }
    }
  }
  double* C = to.C.data();
  for (std::size_t a = first; a < row; ++a) {
    for (int i = 0; i < nw; ++i) {
      const double* y = Y + static_cast<std::size_t>(i) * row;
      const double ya = y[a];
      for (std::size_t j = a - a % width; j < row; ++j) C[a * row + j] -= ya * y[j];
    }
  }
  for (std::size_t a = 0; a < 2 * s.shift_uses; ++a) {
    for (std::size_t b = a; b < 2 * s.shift_uses; ++b) {
      double more = curve[a][b];
      for (int i = 0; i < nw; ++i) more += shares[a].tau[i] * shares[b].tau[i];
      const std::size_t low = std::min(shares[a].column, shares[b].column);
      const std::size_t high = std::max(shares[a].column, shares[b].column);
      C[low * row + high] += more;
    }
  }
}

void begin_slopes(Border& border) { border.c = border.by_gap; }

void approach(Iterate& it, const Stage& s, const double p[nx]) {
  const Share* shares = shares_of(it, s);
  for (std::size_t a = 0; a < 2 * s.shift_uses; ++a) {
    double t = 0.0;
    for (int i = 0; i < nx; ++i) t += shares[a].f[i] * p[i];
    it.border.c[shares[a].column] += t;
  }
}

void pass(Iterate& it, std::size_t k, const double drag[shares_max]) {
  const Stage& s = it.stages[k];
  Border& to = it.border;
  const double* Y = to.Y.data() + k * nw * to.row;
  const Share* shares = shares_of(it, s);
  for (std::size_t a = 0; a < 2 * s.shift_uses; ++a) {
    double t = shares[a].slope - drag[a];
    for (int i = 0; i < nw; ++i) t += shares[a].tau[i] * s.tau[i];
    to.c[shares[a].column] += t;
  }
  for (int i = 0; i < nw; ++i) {
    const double* y = Y + static_cast<std::size_t>(i) * to.row;
    for (std::size_t j = first_of(s); j < to.row; ++j) to.c[j] -= y[j] * s.kappa[i];
  }
}

void add_columns(const Iterate& it, std::size_t k, double out[nw]) {
  const Border& from = it.border;
  const double* Y = from.Y.data() + k * nw * from.row;
  for (int i = 0; i < nw; ++i) {
    const double* y = Y + static_cast<std::size_t>(i) * from.row;
    double t = 0.0;
    for (std::size_t j = first_of(it.stages[k]); j < from.row; ++j) t += y[j] * from.step[j];
    out[i] += t;
  }
}

}  // namespace stridelab
