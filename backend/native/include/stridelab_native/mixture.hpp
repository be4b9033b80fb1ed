// The log-density term of (4.20a): value, gradient and the two parts of its curvature.
//
//   p(y) = sum_j w_j N(y; mu_j, S_j),   gamma_j = w_j N_j / p,   d_j = S_j^-1 (y - mu_j)
//   -grad log p = sum gamma_j d_j
//   -hess log p = sum gamma_j S_j^-1 - Cov_gamma(d)
#pragma once
#include <algorithm>
#include <cmath>

#include "stridelab_native/problem.hpp"

namespace stridelab {

// Sums over the visits of a node, world axes; symmetric matrices as 00, 01, 02, 11, 12, 22.
struct DensityDerivatives {
  double gradient[3];
  double majoriser[6];
  double covariance[6];
};

inline constexpr int eights_max = 8;

// A += weight R B R^T, all symmetric.
inline void add_turned(const double* R, const double* B, double weight, double* A) {
  const double full[9] = {B[0], B[1], B[2], B[1], B[3], B[4], B[2], B[4], B[5]};
  double RB[9];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      RB[3 * i + j] = R[3 * i] * full[j] + R[3 * i + 1] * full[3 + j] + R[3 * i + 2] * full[6 + j];
    }
  }
  int at = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      A[at++] += weight * (RB[3 * i] * R[3 * j] + RB[3 * i + 1] * R[3 * j + 1] + RB[3 * i + 2] * R[3 * j + 2]);
    }
  }
}

// weight * -log p at c; adds the derivatives to `log_density`.
inline double visit(const Visit& at, const Density& density, const double* c, double weight,
                    DensityDerivatives& log_density) {
  const double d[3] = {c[0] - at.place[0], c[1] - at.place[1], c[2] - at.place[2]};
  const double* R = at.R;
  v8 y[3];
  for (int i = 0; i < 3; ++i) y[i] = splat8(R[i] * d[0] + R[3 + i] * d[1] + R[6 + i] * d[2]);

  const int n = static_cast<int>(density.eights.size());
  v8 exponent[eights_max];
  v8 pull[eights_max][3];
  v8 top = splat8(-1e308);
  for (int e = 0; e < n; ++e) {
    const Density::Eight& of = density.eights[static_cast<std::size_t>(e)];
    const v8 a = y[0] - of.mean[0];
    const v8 b = y[1] - of.mean[1];
    const v8 g = y[2] - of.mean[2];
    const v8 w0 = of.W[0] * a;
    const v8 w1 = of.W[1] * a + of.W[2] * b;
    const v8 w2 = of.W[3] * a + of.W[4] * b + of.W[5] * g;
    exponent[e] = of.constant - 0.5 * (w0 * w0 + w1 * w1 + w2 * w2);
    pull[e][0] = of.W[0] * w0 + of.W[1] * w1 + of.W[3] * w2;
    pull[e][1] = of.W[2] * w1 + of.W[4] * w2;
    pull[e][2] = of.W[5] * w2;
    top = top > exponent[e] ? top : exponent[e];
  }
  double highest = top[0];
  for (int i = 1; i < 8; ++i) highest = std::max(highest, top[i]);

  v8 total = splat8(0.0);
  v8 first[3] = {};
  v8 second[6] = {};
  v8 precision[6] = {};
  for (int e = 0; e < n; ++e) {
    const Density::Eight& of = density.eights[static_cast<std::size_t>(e)];
    const v8 gamma = exponential(exponent[e] - highest);
    total += gamma;
    const v8 g0 = gamma * pull[e][0];
    const v8 g1 = gamma * pull[e][1];
    const v8 g2 = gamma * pull[e][2];
    first[0] += g0;
    first[1] += g1;
    first[2] += g2;
    second[0] += g0 * pull[e][0];
    second[1] += g0 * pull[e][1];
    second[2] += g0 * pull[e][2];
    second[3] += g1 * pull[e][1];
    second[4] += g1 * pull[e][2];
    second[5] += g2 * pull[e][2];
    for (int i = 0; i < 6; ++i) precision[i] += gamma * of.precision[i];
  }
  const double p = sum(total);
  const double inverse = 1.0 / p;
  double mean[3];
  double majoriser[6];
  double covariance[6];
  for (int i = 0; i < 3; ++i) mean[i] = sum(first[i]) * inverse;
  int at_entry = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j, ++at_entry) {
      majoriser[at_entry] = sum(precision[at_entry]) * inverse;
      covariance[at_entry] = sum(second[at_entry]) * inverse - mean[i] * mean[j];
    }
  }
  for (int i = 0; i < 3; ++i) {
    log_density.gradient[i] += weight * (R[3 * i] * mean[0] + R[3 * i + 1] * mean[1] + R[3 * i + 2] * mean[2]);
  }
  add_turned(R, majoriser, weight, log_density.majoriser);
  add_turned(R, covariance, weight, log_density.covariance);
  return -weight * (highest + std::log(p));
}

}  // namespace stridelab
