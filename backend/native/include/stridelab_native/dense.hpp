// Small dense linear algebra of a stage: six columns, rows padded to eight.
#pragma once
#include <cmath>

#include "stridelab_native/problem.hpp"

namespace stridelab {

// L L^T = S for a positive semidefinite S (lower triangle read); pivots at rounding level give zero columns.
inline void semidefinite_root(const double S[nw][8], double L[nw][8], double inverse[nw]) {
  for (int j = 0; j < nw; ++j) {
    double d = S[j][j];
    for (int k = 0; k < j; ++k) d -= L[j][k] * L[j][k];
    for (int i = 0; i < j; ++i) L[i][j] = 0.0;
    if (!(d > 1e-14 * S[j][j]) || d < 1e-200) {
      inverse[j] = 0.0;
      for (int i = j; i < nw; ++i) L[i][j] = 0.0;
      continue;
    }
    const double root = std::sqrt(d);
    inverse[j] = 1.0 / root;
    L[j][j] = root;
    for (int i = j + 1; i < nw; ++i) {
      double t = S[i][j];
      for (int k = 0; k < j; ++k) t -= L[i][k] * L[j][k];
      L[i][j] = t * inverse[j];
    }
  }
}

// Lower Cholesky factor in place; false unless positive definite.
inline bool cholesky(double A[nw][8], double inverse[nw]) {
  for (int j = 0; j < nw; ++j) {
    double d = A[j][j];
    for (int k = 0; k < j; ++k) d -= A[j][k] * A[j][k];
    if (!(d > 0.0)) return false;
    const double root = std::sqrt(d);
    inverse[j] = 1.0 / root;
    A[j][j] = root;
    for (int i = j + 1; i < nw; ++i) {
      double t = A[i][j];
      for (int k = 0; k < j; ++k) t -= A[i][k] * A[j][k];
      A[i][j] = t * inverse[j];
    }
  }
  return true;
}

// b := L^-1 b and b := L^-T b; columns without a pivot give 0.
inline void solve_lower(const double L[nw][8], const double inverse[nw], double b[nw]) {
  for (int i = 0; i < nw; ++i) {
    double t = b[i];
    for (int k = 0; k < i; ++k) t -= L[i][k] * b[k];
    b[i] = t * inverse[i];
  }
}

inline void solve_upper(const double L[nw][8], const double inverse[nw], double b[nw]) {
  for (int i = nw - 1; i >= 0; --i) {
    double t = b[i];
    for (int k = i + 1; k < nw; ++k) t -= L[k][i] * b[k];
    b[i] = t * inverse[i];
  }
}

}  // namespace stridelab
