// Small problems made by hand, and what the tests expect with.
#pragma once
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "stridelab_native/problem.hpp"

namespace stridelab {

inline void expect(bool wrench_controls, const char* what) {
  if (wrench_controls) return;
  std::fprintf(stderr, "does not hold: %s\n", what);
  std::exit(1);
}

inline void expect_near(double a, double b, double tolerance, const char* what) {
  if (std::fabs(a - b) <= tolerance) return;
  std::fprintf(stderr, "%s: %.15g is not %.15g within %g\n", what, a, b, tolerance);
  std::exit(1);
}

// Bounds of +-h on c_z in all intervals.
inline void bound_heights(Problem& p, double h) {
  std::size_t intervals = 0;
  for (const Phase& f : p.phases) intervals += static_cast<std::size_t>(f.intervals);
  p.heights.assign(intervals, {-h, h});
}

// Two components about (0, 0, 0.8), the second shifted.
inline Density density() {
  Density d;
  d.eights.resize(1);
  Density::Eight& e = d.eights[0];
  e = Density::Eight{};
  e.constant = splat8(-1e300);
  const double W[2][6] = {{8.0, 1.0, 9.0, -2.0, 0.5, 12.0}, {10.0, -1.0, 7.0, 1.0, 1.5, 15.0}};
  const double mean[2][3] = {{0.0, 0.0, 0.0}, {0.06, -0.04, 0.02}};
  for (int j = 0; j < 2; ++j) {
    e.constant[j] = std::log(0.5) + std::log(W[j][0] * W[j][2] * W[j][5]) - 1.5 * std::log(2.0 * 3.14159265358979);
    for (int i = 0; i < 3; ++i) e.mean[i][j] = mean[j][i];
    for (int i = 0; i < 6; ++i) e.W[i][j] = W[j][i];
    const double L[3][3] = {{W[j][0], 0, 0}, {W[j][1], W[j][2], 0}, {W[j][3], W[j][4], W[j][5]}};
    int at = 0;
    for (int r = 0; r < 3; ++r) {
      for (int c = r; c < 3; ++c, ++at) {
        for (int k = 0; k < 3; ++k) e.precision[at][j] += L[k][r] * L[k][c];
      }
    }
  }
  return d;
}

inline Block sole(double x, double y, double friction) {
  Block b{};
  b.S[0] = b.S[4] = friction;
  b.S[8] = 1.0;
  for (int j = 0; j < 4; ++j) {
    b.p[0][j] = x + (j < 2 ? 0.08 : -0.08);
    b.p[1][j] = y + (j % 2 == 0 ? 0.045 : -0.045);
    b.p[2][j] = -0.8;
  }
  b.real = splat4(1.0);
  b.points = 4;
  b.effort[0] = 2.0 * friction * friction;
  b.effort[1] = 2.0;
  b.normal_max = unbounded;
  b.moved = -1;
  return b;
}

// A step: both feet, the left alone, both again with the right 0.2 m ahead; `air_s` of flight in between.
inline Problem step(double air_s = 0.0) {
  Problem p;
  p.w_momentum = 10.0 * 883.0 * 883.0;
  p.goal = {0.1, 0.0, 0.0, 0, 0, 0, 0, 0, 0};
  p.densities = {density()};
  p.blocks = {sole(0.0, 0.09, 0.3), sole(0.0, -0.09, 0.3), sole(0.0, 0.09, 0.3), sole(0.0, 0.09, 0.3),
              sole(0.2, -0.09, 0.3)};
  p.visits = {{0, {0.0, 0.0, 0.0}, {1, 0, 0, 0, 1, 0, 0, 0, 1}, -1},
              {0, {0.1, 0.0, 0.0}, {0, -1, 0, 1, 0, 0, 0, 0, 1}, -1}};
  const auto phase = [](int intervals, int block, int blocks, int visit, int visits) {
    return Phase{intervals, 0.1, block, blocks, visit, visits, -1};
  };
  p.phases = {phase(7, 0, 2, 0, 1), phase(8, 2, 1, 0, 2), phase(10, 3, 2, 1, 1)};
  if (air_s > 0.0) {
    p.phases.insert(p.phases.begin() + 1, phase(2, 0, 0, 0, 0));
    p.phases[1].h = air_s / 2.0;
  }
  return p;
}

// The same with the wrench as control: in the pyramid of the sole's forces and torques, roughly.
inline Problem wrench_step() {
  Problem p = step();
  const double y[3] = {0.0, 0.09, 0.0};
  for (int i = 0; i < 3; ++i) {
    WrenchCone cone{};
    const double x = i == 2 ? 0.1 : 0.0;
    cone.G[0][0] = cone.G[1][1] = 0.15;
    cone.G[2][5] = 1.0;
    cone.G[3][2] = cone.G[4][3] = i == 1 ? 0.02 : 0.05;
    cone.G[5][4] = 0.01;
    const double at[3] = {x, y[i], -0.8};
    for (int j = 0; j < nw; ++j) {
      cone.G[3][j] += at[1] * cone.G[2][j] - at[2] * cone.G[1][j];
      cone.G[4][j] += at[2] * cone.G[0][j] - at[0] * cone.G[2][j];
      cone.G[5][j] += at[0] * cone.G[1][j] - at[1] * cone.G[0][j];
    }
    p.cones.push_back(cone);
    p.phases[static_cast<std::size_t>(i)].blocks = 0;
    p.phases[static_cast<std::size_t>(i)].cone = i;
  }
  return p;
}

}  // namespace stridelab
