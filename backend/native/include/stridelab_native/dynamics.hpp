// The exact step x+ = A x + B (F, T) + b over h with a constant wrench, x = (c, c', K):
//
//   c+ = c + h c' + h^2/2 g (F - z),   c'+ = c' + h g (F - z),
//   K+ = K + h T + a (h c + h^2/2 c' + h^3/6 g F),    a(v) = v x down = (-v_y, v_x, 0)
#pragma once
#include "stridelab_native/problem.hpp"

namespace stridelab {

// A x + B w, and with b.
inline void advance_linear(double h, const double* x, const double* w, double* out) {
  const double half = 0.5 * h * h * gravity;
  const double sixth = h * h * h / 6.0 * gravity;
  for (int i = 0; i < 3; ++i) {
    out[i] = x[i] + h * x[3 + i] + half * w[i];
    out[3 + i] = x[3 + i] + h * gravity * w[i];
    out[6 + i] = x[6 + i] + h * w[3 + i];
  }
  out[6] -= h * x[1] + 0.5 * h * h * x[4] + sixth * w[1];
  out[7] += h * x[0] + 0.5 * h * h * x[3] + sixth * w[0];
}

inline void advance(double h, const double* x, const double* w, double* out) {
  advance_linear(h, x, w, out);
  out[2] -= 0.5 * h * h * gravity;
  out[5] -= h * gravity;
}

// A^T l and B^T l.
inline void pull_back(double h, const double* l, double* to_x, double* to_w) {
  const double half = 0.5 * h * h;
  for (int i = 0; i < 3; ++i) {
    to_x[i] = l[i];
    to_x[3 + i] = l[3 + i] + h * l[i];
    to_x[6 + i] = l[6 + i];
    to_w[i] = gravity * (half * l[i] + h * l[3 + i]);
    to_w[3 + i] = h * l[6 + i];
  }
  to_x[0] += h * l[7];
  to_x[1] -= h * l[6];
  to_x[3] += half * l[7];
  to_x[4] -= half * l[6];
  to_w[0] += h * h * h / 6.0 * gravity * l[7];
  to_w[1] -= h * h * h / 6.0 * gravity * l[6];
}

}  // namespace stridelab
