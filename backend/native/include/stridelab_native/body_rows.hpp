// Rows of the task hierarchy of one contact phase; formulas and order as in wholebody/control/task_stack.py and
// tasks.py.
#pragma once
#include <array>
#include <cstddef>
#include <vector>

#include "stridelab_native/view.hpp"

namespace stridelab {

// Stiffness (1/s^2) and damping (1/s) of an error.
struct Gain {
  double kp = 0.0, kd = 0.0;
};

struct BodyContact {
  bool surface = true;
  Gain gain;
  std::array<double, 3> position{};
  std::array<double, 9> rotation{};
  std::vector<std::array<double, 3>> points;
};

// What is the same at all samples of a phase; joints are the actuated ones, in the order of the velocity from 6 on.
struct BodyPhase {
  std::vector<BodyContact> contacts;
  std::vector<bool> swings_surface;
  std::vector<double> lower_rad, upper_rad, velocity_rad_s, torque_nm, rest_rad, posture_weight, force_weight;
  std::vector<std::size_t> ankles;
  Gain com, effector, base, posture, hand, ankle;
  double mass_kg = 0.0, momentum_weight = 0.0, momentum_per_s = 0.0, base_weight = 0.0, hand_weight = 0.0;
  double ankle_weight = 0.0, ankle_acts_rad = 0.0, ankle_ahead_s = 0.0;
  double barrier_per_s = 0.0, velocity_rate_per_s = 0.0, acceleration_rad_s2 = 0.0;

  std::size_t joints() const { return rest_rad.size(); }
  std::size_t forces() const { return force_weight.size(); }
  std::size_t unknowns() const { return 6 + joints() + forces(); }
};

struct BodyFrame {
  View position, rotation, J, velocity, drift;
};

struct SwingTarget {
  View position, velocity, acceleration, rotation, angular_velocity, angular_acceleration;
};

// The state of the body, and its targets; frames are those of the contacts, of the swings, and of the base.
struct BodySample {
  View q, v, M, h, A_g, A_g_drift, com, com_v, l;
  std::vector<BodyFrame> frames;
  View com_ref, com_v_ref, com_a_ref, l_ref, l_rate_ref, base_rotation, base_w, base_w_rate;
  std::vector<SwingTarget> swings;
  View planned_n, avoid_A, avoid_b, avoid_weight;
  std::size_t avoid_rows = 0;
};

// Arrays of the caller that are filled: ``A z = b`` of levels 0 and 1, those of level 2, and ``lower <= G z <= upper``.
struct BodyArrays {
  double *A, *b, *A_2, *b_2, *G, *lower, *upper;
  std::size_t torque_row;  // first row of the torques in G; those of the joints' ranges follow
};

// Fills the arrays; returns the number of rows of level 2.
std::size_t fill_body_rows(const BodyPhase& phase, const BodySample& sample, const BodyArrays& arrays);

// Rotation vector (world axes) that turns ``actual`` into ``reference``.
std::array<double, 3> rotation_error(const View& reference, const View& actual);

}  // namespace stridelab
