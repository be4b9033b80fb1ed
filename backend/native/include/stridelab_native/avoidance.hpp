// Task rows that keep pairs of shapes apart; formulas and order as in wholebody/control/collision_avoidance.py.
#pragma once
#include <cstddef>
#include <vector>

#include "stridelab_native/view.hpp"

namespace stridelab {

struct AvoidanceGains {
  double apart_m = 0.0, acts_m = 0.0, kp = 0.0, kd = 0.0, weight = 0.0, firmest = 0.0;
  double lever_m = 0.0, short_lever = 0.0, urgent = 0.0;
};

// All pairs of a robot on a terrain: per pair the sign of each joint's motion, the share of it that the task uses, the
// scale of its distances, and whether its target moves instead of its joints.
struct AvoidancePairs {
  std::size_t nv = 0;
  std::vector<double> sign, moving, scale;
  std::vector<bool> moves_target;
  AvoidanceGains gains;
};

// Near pairs: their numbers, distances and nearest points; J of the whole body about the world's origin, and v.
struct NearPairs {
  std::vector<std::size_t> pair;
  View distance, p_1, p_2, J, v;
};

// Arrays of the caller: per near pair the normal (3), its nearness (0 to 1) and acceleration; then the rows of the
// tasks.
struct AvoidanceArrays {
  double *normals, *nearness, *accelerations, *A, *b, *weights;
};

// Fills the arrays; returns the number of rows of tasks.
std::size_t fill_avoidance(const AvoidancePairs& pairs, const NearPairs& near, const AvoidanceArrays& arrays);

}  // namespace stridelab
