// Rows that keep pairs of shapes apart, beside values by hand: a slide along x and a turn about z.
#include <array>
#include <cmath>
#include <cstdio>

#include "problems.hpp"
#include "stridelab_native/avoidance.hpp"

using namespace stridelab;

namespace {

AvoidancePairs three_pairs() {
  AvoidancePairs pairs;
  pairs.nv = 2;
  pairs.sign = {1.0, -1.0, 1.0, 1.0, 1.0, 1.0};
  pairs.moving = {1.0, 0.5, 1.0, 1.0, 1.0, 1.0};
  pairs.scale = {1.0, 0.5, 1.0};
  pairs.moves_target = {false, true, false};
  pairs.gains = {0.05, 0.1, 100.0, 20.0, 2.0, 4.0, 0.5, 3.0, 5.0};
  return pairs;
}

void rows_are_those_by_hand() {
  const std::array<double, 12> J{1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  const std::array<double, 2> v{-0.5, 0.1};
  // apart by 4 cm along x; 1 cm inside each other along z; the same point
  const std::array<double, 3> distance{0.04, -0.01, 0.0};
  const std::array<double, 9> p_1{0.1, 0.2, 0.0, 0.0, 0.0, 0.1, 0.3, 0.3, 0.3};
  const std::array<double, 9> p_2{0.06, 0.2, 0.0, 0.0, 0.0, 0.11, 0.3, 0.3, 0.3};
  std::array<double, 9> normals{};
  std::array<double, 3> nearness{}, accelerations{}, b{}, weights{};
  std::array<double, 6> A{};
  const NearPairs near{{0, 1, 2},          {distance.data(), 1, 0}, {p_1.data(), 3, 1},
                       {p_2.data(), 3, 1}, {J.data(), 2, 1},        {v.data(), 1, 0}};
  const std::size_t rows = fill_avoidance(
      three_pairs(), near, {normals.data(), nearness.data(), accelerations.data(), A.data(), b.data(), weights.data()});
  expect_near(static_cast<double>(rows), 2.0, 0.0, "a pair that moves its target has no row");
  const std::array<double, 9> up{1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0};
  for (std::size_t i = 0; i < 9; ++i) expect_near(normals[i], up[i], 1e-12, "normal");
  for (const double one : nearness) expect_near(one, 1.0, 1e-12, "nearness");
  // the turn moves the point by -0.2 m/rad along x, with the other sign: approach at 0.5 - 0.02 m/s
  expect_near(accelerations[0], 100.0 * 0.01 + 20.0 * 0.48, 1e-12, "acceleration of the first pair");
  expect_near(accelerations[1], 100.0 * 2.0 * 0.035, 1e-12, "half the scale, twice as firm");
  expect_near(accelerations[2], 100.0 * 0.05, 1e-12, "pushed apart upwards");
  expect_near(A[0], 1.0, 1e-12, "slide");
  expect_near(A[1], 0.1, 1e-12, "half of the turn");
  expect_near(b[0], accelerations[0], 0.0, "target");
  expect_near(weights[0], 2.0 * (1.0 + 5.0 * 0.2), 1e-12, "weight");
  expect_near(weights[1], 2.0 * 3.0 * (1.0 + 5.0), 1e-12, "a short lever weighs more");
}

}  // namespace

int main() {
  rows_are_those_by_hand();
  std::puts("rows that keep shapes apart are those by hand");
  return 0;
}
