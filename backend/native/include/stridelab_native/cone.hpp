// Lorentz cones |tau| <= eta, u = (tau, eta), with their duals z and Nesterov-Todd scaling: those of four points at
// once, T a vector of four and n = 3, or that of a wrench, T a number and n = 6.
//
//   W z = W^-1 u = lambda,   W = beta [ w_0  w_1^T ; w_1  I + w_1 w_1^T / (1 + w_0) ],   W^-2 = (2 v v^T - J) / beta^2,
//   v = J w
#pragma once
#include "stridelab_native/vec.hpp"

namespace stridelab {

template <typename T, int n>
struct Cone {
  T u[n];  // tau, eta
  T z[n];
};
using Cones = Cone<v4, 3>;

template <typename T, int n>
struct Scaling {
  T w[n];  // w_1, w_0
  T inverse_beta;
  T lambda[n];
};

template <typename T, int n>
T product(const T (&a)[n], const T (&b)[n]) {
  T all = a[0] * b[0];
  for (int i = 1; i < n; ++i) all += a[i] * b[i];
  return all;
}

// Inner product of the tau parts.
template <typename T, int n>
T across(const T (&a)[n], const T (&b)[n]) {
  T all = a[0] * b[0];
  for (int i = 1; i < n - 1; ++i) all += a[i] * b[i];
  return all;
}

// eta^2 - |tau|^2 without its cancellation.
template <typename T, int n>
T determinant(const T (&u)[n]) {
  const T t = root(across(u, u));
  return (u[n - 1] - t) * (u[n - 1] + t);
}

template <typename T, int n>
Scaling<T, n> scaling(const Cone<T, n>& c) {
  constexpr int head = n - 1;
  const T s_j = root(determinant(c.u));
  const T z_j = root(determinant(c.z));
  const T is = 1.0 / s_j;
  const T iz = 1.0 / z_j;
  T a[n];
  T b[n];
  for (int i = 0; i < n; ++i) a[i] = c.u[i] * is;
  for (int i = 0; i < n; ++i) b[i] = c.z[i] * iz;
  const T gamma = root(0.5 * (1.0 + product(a, b)));
  const T half = 0.5 / gamma;
  Scaling<T, n> r{};
  for (int i = 0; i < head; ++i) r.w[i] = (a[i] - b[i]) * half;
  r.w[head] = (a[head] + b[head]) * half;
  const T beta = root(s_j * iz);
  r.inverse_beta = 1.0 / beta;
  const T inner = across(r.w, c.z);
  const T share = c.z[head] + inner / (1.0 + r.w[head]);
  for (int i = 0; i < head; ++i) r.lambda[i] = beta * (c.z[i] + r.w[i] * share);
  r.lambda[head] = beta * (r.w[head] * c.z[head] + inner);
  return r;
}

// W^-1 a, and W a.
template <typename T, int n>
void unscale(const Scaling<T, n>& s, const T (&a)[n], T (&out)[n]) {
  constexpr int head = n - 1;
  const T inner = across(s.w, a);
  const T share = a[head] - inner / (1.0 + s.w[head]);
  out[head] = s.inverse_beta * (s.w[head] * a[head] - inner);
  for (int i = 0; i < head; ++i) out[i] = s.inverse_beta * (a[i] - s.w[i] * share);
}

template <typename T, int n>
void scale(const Scaling<T, n>& s, const T (&a)[n], T (&out)[n]) {
  constexpr int head = n - 1;
  const T inner = across(s.w, a);
  const T share = a[head] + inner / (1.0 + s.w[head]);
  const T beta = 1.0 / s.inverse_beta;
  out[head] = beta * (s.w[head] * a[head] + inner);
  for (int i = 0; i < head; ++i) out[i] = beta * (a[i] + s.w[i] * share);
}

// x with lambda o x = v in the Jordan algebra of the cone.
template <typename T, int n>
void divide(const T (&lambda)[n], const T (&v)[n], T (&x)[n]) {
  constexpr int head = n - 1;
  const T top = (lambda[head] * v[head] - across(lambda, v)) / determinant(lambda);
  const T inverse = 1.0 / lambda[head];
  for (int i = 0; i < head; ++i) x[i] = (v[i] - top * lambda[i]) * inverse;
  x[head] = top;
}

// The longest step along d that stays in the cone; in the scaled space of lambda: a = W^-1 du or W dz.
//   rho = (lambda_bar^T J a, ..) / sqrt det lambda,   alpha = 1 / max(0, |rho_1| - rho_0)
template <typename T, int n>
T longest(const T (&lambda)[n], const T (&a)[n]) {
  constexpr int head = n - 1;
  const T size = 1.0 / root(determinant(lambda));
  T l[n];
  for (int i = 0; i < n; ++i) l[i] = lambda[i] * size;
  const T top = l[head] * a[head] - across(l, a);
  const T share = (top + a[head]) / (l[head] + 1.0);
  T r[n];
  for (int i = 0; i < head; ++i) r[i] = a[i] - share * l[i];
  const T beyond = (root(across(r, r)) - top) * size;
  const T tiny = T{} + 1e-9;
  return 1.0 / (beyond > tiny ? beyond : tiny);
}

// W^-2: 00, 01, 02, 11, 12, 22 in the order (tau_0, tau_1, eta).
inline void inverse_square(const Scaling<v4, 3>& s, v4* E) {
  const v4 f = s.inverse_beta * s.inverse_beta;
  const v4 two = 2.0 * f;
  E[0] = two * s.w[0] * s.w[0] + f;
  E[1] = two * s.w[0] * s.w[1];
  E[2] = -two * s.w[0] * s.w[2];
  E[3] = two * s.w[1] * s.w[1] + f;
  E[4] = -two * s.w[1] * s.w[2];
  E[5] = two * s.w[2] * s.w[2] - f;
}

// (diag(e, e, e_n) + W^-2)^-1: in the same order. With f = 1 / beta^2, along w_1 and eta its inverse is
// [e + f + 2 f |w_1|^2, -2 f |w_1| w_0; ., e_n + f + 2 f |w_1|^2], whose determinant has no cancellation:
//   (e + f) (e_n + f) + 2 f |w_1|^2 (e + e_n)
inline void invert(const Scaling<v4, 3>& s, v4 e, v4 e_n, v4* I) {
  const v4 f = s.inverse_beta * s.inverse_beta;
  const v4 along = 2.0 * f * across(s.w, s.w);
  const v4 across_it = 1.0 / (e + f);
  const v4 g = 2.0 * f / ((e + f) * (e_n + f) + along * (e + e_n));
  const v4 k = g * (f - e_n) * across_it;
  I[0] = across_it + k * s.w[0] * s.w[0];
  I[1] = k * s.w[0] * s.w[1];
  I[2] = g * s.w[2] * s.w[0];
  I[3] = across_it + k * s.w[1] * s.w[1];
  I[4] = g * s.w[2] * s.w[1];
  I[5] = g * (e + f + along) / (2.0 * f);
}

inline void times(const v4* A, const v4* x, v4* y) {
  y[0] = A[0] * x[0] + A[1] * x[1] + A[2] * x[2];
  y[1] = A[1] * x[0] + A[3] * x[1] + A[4] * x[2];
  y[2] = A[2] * x[0] + A[4] * x[1] + A[5] * x[2];
}

}  // namespace stridelab
