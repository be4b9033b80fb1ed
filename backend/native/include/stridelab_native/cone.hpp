// Four Lorentz cones |tau| <= eta at once, u = (tau_0, tau_1, eta), with their duals z and Nesterov-Todd scaling:
//
//   W z = W^-1 u = lambda,   W = beta [ w_0  w_1^T ; w_1  I + w_1 w_1^T / (1 + w_0) ],   W^-2 = (2 v v^T - J) / beta^2,
//   v = J w
#pragma once
#include "stridelab_native/vec.hpp"

namespace stridelab {

struct Cones {
  v4 u[3];  // tau_0, tau_1, eta
  v4 z[3];
};

struct Scaling {
  v4 w[3];  // w_1 (two), w_0
  v4 inverse_beta;
  v4 lambda[3];
};

inline v4 product(const v4* a, const v4* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// eta^2 - |tau|^2 without its cancellation.
inline v4 determinant(const v4* u) {
  const v4 t = root(u[0] * u[0] + u[1] * u[1]);
  return (u[2] - t) * (u[2] + t);
}

inline Scaling scaling(const Cones& c) {
  const v4 s_j = root(determinant(c.u));
  const v4 z_j = root(determinant(c.z));
  const v4 is = 1.0 / s_j;
  const v4 iz = 1.0 / z_j;
  const v4 a[3] = {c.u[0] * is, c.u[1] * is, c.u[2] * is};
  const v4 b[3] = {c.z[0] * iz, c.z[1] * iz, c.z[2] * iz};
  const v4 gamma = root(0.5 * (1.0 + product(a, b)));
  const v4 half = 0.5 / gamma;
  Scaling r{};
  r.w[0] = (a[0] - b[0]) * half;
  r.w[1] = (a[1] - b[1]) * half;
  r.w[2] = (a[2] + b[2]) * half;
  const v4 beta = root(s_j * iz);
  r.inverse_beta = 1.0 / beta;
  const v4 inner = r.w[0] * c.z[0] + r.w[1] * c.z[1];
  const v4 share = c.z[2] + inner / (1.0 + r.w[2]);
  r.lambda[0] = beta * (c.z[0] + r.w[0] * share);
  r.lambda[1] = beta * (c.z[1] + r.w[1] * share);
  r.lambda[2] = beta * (r.w[2] * c.z[2] + inner);
  return r;
}

// W^-1 a, and W a.
inline void unscale(const Scaling& s, const v4* a, v4* out) {
  const v4 inner = s.w[0] * a[0] + s.w[1] * a[1];
  const v4 share = a[2] - inner / (1.0 + s.w[2]);
  out[0] = s.inverse_beta * (a[0] - s.w[0] * share);
  out[1] = s.inverse_beta * (a[1] - s.w[1] * share);
  out[2] = s.inverse_beta * (s.w[2] * a[2] - inner);
}

inline void scale(const Scaling& s, const v4* a, v4* out) {
  const v4 inner = s.w[0] * a[0] + s.w[1] * a[1];
  const v4 share = a[2] + inner / (1.0 + s.w[2]);
  const v4 beta = 1.0 / s.inverse_beta;
  out[0] = beta * (a[0] + s.w[0] * share);
  out[1] = beta * (a[1] + s.w[1] * share);
  out[2] = beta * (s.w[2] * a[2] + inner);
}

// x with lambda o x = v in the Jordan algebra of the cone.
inline void divide(const v4* lambda, const v4* v, v4* x) {
  const v4 head = (lambda[2] * v[2] - lambda[0] * v[0] - lambda[1] * v[1]) / determinant(lambda);
  const v4 inverse = 1.0 / lambda[2];
  x[0] = (v[0] - head * lambda[0]) * inverse;
  x[1] = (v[1] - head * lambda[1]) * inverse;
  x[2] = head;
}

// W^-2: 00, 01, 02, 11, 12, 22 in the order (tau_0, tau_1, eta).
inline void inverse_square(const Scaling& s, v4* E) {
  const v4 f = s.inverse_beta * s.inverse_beta;
  const v4 two = 2.0 * f;
  E[0] = two * s.w[0] * s.w[0] + f;
  E[1] = two * s.w[0] * s.w[1];
  E[2] = -two * s.w[0] * s.w[2];
  E[3] = two * s.w[1] * s.w[1] + f;
  E[4] = -two * s.w[1] * s.w[2];
  E[5] = two * s.w[2] * s.w[2] - f;
}

// Inverse of a positive definite symmetric matrix by L D L^T.
inline void invert(const v4* A, v4* I) {
  const v4 d0 = 1.0 / A[0];
  const v4 l1 = A[1] * d0;
  const v4 l2 = A[2] * d0;
  const v4 d1 = 1.0 / (A[3] - l1 * A[1]);
  const v4 c = A[4] - l1 * A[2];
  const v4 l3 = c * d1;
  const v4 d2 = 1.0 / (A[5] - l2 * A[2] - l3 * c);
  const v4 m = l1 * l3 - l2;  // L^-1 = [1; -l1 1; m -l3 1]
  I[0] = d0 + l1 * l1 * d1 + m * m * d2;
  I[1] = -l1 * d1 - m * l3 * d2;
  I[2] = m * d2;
  I[3] = d1 + l3 * l3 * d2;
  I[4] = -l3 * d2;
  I[5] = d2;
}

inline void times(const v4* A, const v4* x, v4* y) {
  y[0] = A[0] * x[0] + A[1] * x[1] + A[2] * x[2];
  y[1] = A[1] * x[0] + A[3] * x[1] + A[4] * x[2];
  y[2] = A[2] * x[0] + A[4] * x[1] + A[5] * x[2];
}

// The longest step along d that stays in the cone; in the scaled space of lambda: a = W^-1 du or W dz.
//   rho = (lambda_bar^T J a, ..) / sqrt det lambda,   alpha = 1 / max(0, |rho_1| - rho_0)
inline v4 longest(const v4* lambda, const v4* a) {
  const v4 size = 1.0 / root(determinant(lambda));
  const v4 l[3] = {lambda[0] * size, lambda[1] * size, lambda[2] * size};
  const v4 head = l[2] * a[2] - l[0] * a[0] - l[1] * a[1];
  const v4 share = (head + a[2]) / (l[2] + 1.0);
  const v4 r0 = a[0] - share * l[0];
  const v4 r1 = a[1] - share * l[1];
  const v4 beyond = (root(r0 * r0 + r1 * r1) - head) * size;
  const v4 tiny = splat4(1e-9);
  return 1.0 / (beyond > tiny ? beyond : tiny);
}

}  // namespace stridelab
