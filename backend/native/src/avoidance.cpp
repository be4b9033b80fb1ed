#include "stridelab_native/avoidance.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace stridelab {

namespace {

constexpr double tiny_m = 1e-9;

using Vector = std::array<double, 3>;

// Unit vector from the second shape to the first, also for penetrating shapes.
Vector contact_normal(const NearPairs& near, std::size_t i) {
  Vector n{};
  double square = 0.0;
  for (std::size_t c = 0; c < 3; ++c) {
    n[c] = near.p_1(i, c) - near.p_2(i, c);
    square += n[c] * n[c];
  }
  const double length = std::sqrt(square), d = near.distance(i);
  if (!(length > tiny_m)) return {0.0, 0.0, 1.0};
  const double sign = d > 0.0 ? 1.0 : d < 0.0 ? -1.0 : 0.0;
  for (double& component : n) component *= sign / length;
  return n;
}

}  // namespace

std::size_t fill_avoidance(const AvoidancePairs& pairs, const NearPairs& near, const AvoidanceArrays& arrays) {
  const AvoidanceGains& g = pairs.gains;
  const std::size_t nv = pairs.nv;
  std::vector<double> row(nv);
  std::size_t rows = 0;
  for (std::size_t i = 0; i < near.pair.size(); ++i) {
    const std::size_t k = near.pair[i];
    const Vector n = contact_normal(near, i);
    std::copy(n.begin(), n.end(), arrays.normals + 3 * i);
    const double x = near.p_1(i, 0), y = near.p_1(i, 1), z = near.p_1(i, 2);
    const double wrench[6] = {n[0], n[1], n[2], y * n[2] - z * n[1], z * n[0] - x * n[2], x * n[1] - y * n[0]};
    double rate = 0.0;
    for (std::size_t j = 0; j < nv; ++j) {
      double along = 0.0;
      for (std::size_t c = 0; c < 6; ++c) along += wrench[c] * near.J(c, j);
      row[j] = along * pairs.sign[k * nv + j];
      rate += row[j] * near.v(j);
    }
    const double d = near.distance(i), scale = pairs.scale[k];
    const double apart_m = scale * g.apart_m, acts_m = scale * g.acts_m, firm = std::min(1.0 / scale, g.firmest);
    const double inside = std::min(std::max(1.0 - d / apart_m, 0.0), 1.0);
    const double nearness = std::min(1.0, (acts_m - d) / (acts_m - apart_m));
    const double acceleration =
        g.kp * firm * std::max(0.0, apart_m - d) + g.kd * std::sqrt(firm) * std::max(0.0, -rate);
    arrays.nearness[i] = nearness;
    arrays.accelerations[i] = acceleration;
    if (pairs.moves_target[k]) continue;
    double square = 0.0;
    double* const task = arrays.A + rows * nv;
    for (std::size_t j = 0; j < nv; ++j) {
      task[j] = row[j] * pairs.moving[k * nv + j];
      square += task[j] * task[j];
    }
    const double lever_m = std::max(std::sqrt(square), tiny_m);
    const double lever = std::min(std::max(g.lever_m / lever_m, 1.0), g.short_lever);
    arrays.b[rows] = acceleration;
    arrays.weights[rows] = g.weight * nearness * nearness * lever * (1.0 + g.urgent * inside);
    ++rows;
  }
  return rows;
}

}  // namespace stridelab
