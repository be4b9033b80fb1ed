#include "stridelab_native/body_rows.hpp"

#include <algorithm>
#include <cmath>

namespace stridelab {

namespace {

using Vector = std::array<double, 3>;

// Writes rows one after the other into a matrix with ``columns`` columns and a right-hand side.
struct RowWriter {
  double *A, *b;
  std::size_t columns;

  // ``weight (J_i a) = weight b_i`` for ``n`` rows of J from ``first`` on.
  template <std::size_t n>
  void write(double weight, const View& J, std::size_t first, std::size_t nv, const std::array<double, n>& values) {
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < nv; ++j) A[j] = weight * J(first + i, j);
      std::fill(A + nv, A + columns, 0.0);
      *b++ = weight * values[i];
      A += columns;
    }
  }

  void write_one(double weight, std::size_t column, double coefficient, double value) {
    std::fill(A, A + columns, 0.0);
    A[column] = weight * coefficient;
    *b++ = weight * value;
    A += columns;
  }
};

View view_of(const std::array<double, 9>& rotation) { return {rotation.data(), 3, 1}; }

// a_ref + kp (p_ref - p) + kd (v_ref - v) - dJ v
Vector position_rate(const BodyFrame& frame, const View& p, const View& v, const View& a, const Gain& gain) {
  Vector rate{};
  for (std::size_t i = 0; i < 3; ++i) {
    rate[i] = a(i) + gain.kp * (p(i) - frame.position(i)) + gain.kd * (v(i) - frame.velocity(i)) - frame.drift(i);
  }
  return rate;
}

Vector orientation_rate(const BodyFrame& frame, const View& R, const View& w, const View& w_rate, const Gain& gain) {
  const Vector error = rotation_error(R, frame.rotation);
  Vector rate{};
  for (std::size_t i = 0; i < 3; ++i) {
    rate[i] = w_rate(i) + gain.kp * error[i] + gain.kd * (w(i) - frame.velocity(3 + i)) - frame.drift(3 + i);
  }
  return rate;
}

// Rows of the forces' Jacobian, J_p = J_v - [R p]x J_w, as columns of the equations of motion: A -= J_f'.
void fill_force_columns(const BodyPhase& phase, const BodySample& sample, const BodyArrays& arrays) {
  const std::size_t nv = 6 + phase.joints(), nz = phase.unknowns();
  std::size_t column = nv;
  for (std::size_t c = 0; c < phase.contacts.size(); ++c) {
    const BodyFrame& frame = sample.frames[c];
    for (const Vector& point : phase.contacts[c].points) {
      Vector r{};
      for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t k = 0; k < 3; ++k) r[i] += frame.rotation(i, k) * point[k];
      }
      for (std::size_t j = 0; j < nv; ++j) {
        const double w[3] = {frame.J(3, j), frame.J(4, j), frame.J(5, j)};
        const double moved[3] = {frame.J(0, j) + r[2] * w[1] - r[1] * w[2], frame.J(1, j) - r[2] * w[0] + r[0] * w[2],
                                 frame.J(2, j) + r[1] * w[0] - r[0] * w[1]};
        double* row = j < 6 ? arrays.A + j * nz : arrays.G + (arrays.torque_row + j - 6) * nz;
        for (std::size_t i = 0; i < 3; ++i) row[column + i] = -moved[i];
      }
      column += 3;
    }
  }
}

void fill_equalities(const BodyPhase& phase, const BodySample& sample, const BodyArrays& arrays) {
  const std::size_t nv = 6 + phase.joints(), nz = phase.unknowns();
  for (std::size_t i = 0; i < 6; ++i) {
    for (std::size_t j = 0; j < nv; ++j) arrays.A[i * nz + j] = sample.M(i, j);
    arrays.b[i] = -sample.h(i);
  }
  RowWriter rows{arrays.A + 6 * nz, arrays.b + 6, nz};
  for (std::size_t c = 0; c < phase.contacts.size(); ++c) {
    const BodyContact& contact = phase.contacts[c];
    const BodyFrame& frame = sample.frames[c];
    const Vector turn = contact.surface ? rotation_error(view_of(contact.rotation), frame.rotation) : Vector{};
    std::array<double, 6> rate{};
    for (std::size_t i = 0; i < 6; ++i) {
      const double error = i < 3 ? contact.position[i] - frame.position(i) : turn[i - 3];
      rate[i] = contact.gain.kp * error - contact.gain.kd * frame.velocity(i) - frame.drift(i);
    }
    if (contact.surface) {
      rows.write(1.0, frame.J, 0, nv, rate);
    } else {
      rows.write(1.0, frame.J, 0, nv, Vector{rate[0], rate[1], rate[2]});
    }
  }
  Vector com_a{};
  for (std::size_t i = 0; i < 3; ++i) {
    com_a[i] = phase.mass_kg * (sample.com_a_ref(i) + phase.com.kp * (sample.com_ref(i) - sample.com(i)) +
                                phase.com.kd * (sample.com_v_ref(i) - sample.com_v(i))) -
               sample.A_g_drift(i);
  }
  rows.write(1.0 / phase.mass_kg, sample.A_g, 0, nv, com_a);
  for (std::size_t s = 0; s < sample.swings.size(); ++s) {
    const BodyFrame& frame = sample.frames[phase.contacts.size() + s];
    const SwingTarget& target = sample.swings[s];
    rows.write(1.0, frame.J, 0, nv,
               position_rate(frame, target.position, target.velocity, target.acceleration, phase.effector));
    if (phase.swings_surface[s]) {
      rows.write(1.0, frame.J, 3, nv,
                 orientation_rate(frame, target.rotation, target.angular_velocity, target.angular_acceleration,
                                  phase.effector));
    }
  }
}

void fill_ankles(const BodyPhase& phase, const BodySample& sample, RowWriter& rows) {
  for (const std::size_t column : phase.ankles) {
    const double q = sample.q(column + 1), v = sample.v(column);
    const double to_lower = q - phase.lower_rad[column - 6], to_upper = phase.upper_rad[column - 6] - q;
    const double away = to_lower < to_upper ? 1.0 : -1.0, distance = std::min(to_lower, to_upper);
    const double nearest = std::min(distance, distance + phase.ankle_ahead_s * away * v);
    const double near = std::clamp(1.0 - nearest / phase.ankle_acts_rad, 0.0, 1.0);
    rows.write_one(phase.ankle_weight * near * near, column, away,
                   phase.ankle.kp * std::max(0.0, phase.ankle_acts_rad - distance) - phase.ankle.kd * away * v);
  }
}

std::size_t fill_level_2(const BodyPhase& phase, const BodySample& sample, const BodyArrays& arrays) {
  const std::size_t nv = 6 + phase.joints(), nc = phase.contacts.size();
  static const double none[3] = {0.0, 0.0, 0.0};
  const View zero{none, 1, 0};
  RowWriter rows{arrays.A_2, arrays.b_2, phase.unknowns()};
  Vector l_rate{};
  for (std::size_t i = 0; i < 3; ++i) {
    l_rate[i] = sample.l_rate_ref(i) + phase.momentum_per_s * (sample.l_ref(i) - sample.l(i)) - sample.A_g_drift(3 + i);
  }
  rows.write(phase.momentum_weight, sample.A_g, 3, nv, l_rate);
  const BodyFrame& base = sample.frames.back();
  rows.write(phase.base_weight, base.J, 3, nv,
             orientation_rate(base, sample.base_rotation, sample.base_w, sample.base_w_rate, phase.base));
  for (std::size_t j = 0; j < phase.joints(); ++j) {
    rows.write_one(phase.posture_weight[j], 6 + j, 1.0,
                   phase.posture.kp * (phase.rest_rad[j] - sample.q(7 + j)) - phase.posture.kd * sample.v(6 + j));
  }
  for (std::size_t i = 0; i < sample.avoid_rows; ++i) {
    rows.write(sample.avoid_weight(i), sample.avoid_A, i, nv, std::array<double, 1>{sample.avoid_b(i)});
  }
  fill_ankles(phase, sample, rows);
  for (std::size_t c = 0; c < nc; ++c) {
    if (!phase.contacts[c].surface) {
      rows.write(phase.hand_weight, sample.frames[c].J, 3, nv,
                 orientation_rate(sample.frames[c], view_of(phase.contacts[c].rotation), zero, zero, phase.hand));
    }
  }
  for (std::size_t s = 0; s < sample.swings.size(); ++s) {
    const BodyFrame& frame = sample.frames[nc + s];
    const SwingTarget& target = sample.swings[s];
    if (!phase.swings_surface[s]) {
      rows.write(
          phase.hand_weight, frame.J, 3, nv,
          orientation_rate(frame, target.rotation, target.angular_velocity, target.angular_acceleration, phase.hand));
    }
  }
  for (std::size_t f = 0; f < phase.forces(); ++f) {
    rows.write_one(phase.force_weight[f], nv + f, 1.0, sample.planned_n(f));
  }
  return static_cast<std::size_t>(rows.b - arrays.b_2);
}

void fill_bounds(const BodyPhase& phase, const BodySample& sample, const BodyArrays& arrays) {
  const std::size_t na = phase.joints(), nv = 6 + na, nz = phase.unknowns();
  const double k = phase.barrier_per_s, k_v = phase.velocity_rate_per_s, most = phase.acceleration_rad_s2;
  for (std::size_t j = 0; j < na; ++j) {
    const std::size_t torque = arrays.torque_row + j, range = torque + na;
    for (std::size_t i = 0; i < nv; ++i) arrays.G[torque * nz + i] = sample.M(6 + j, i);
    arrays.upper[torque] = phase.torque_nm[j] - sample.h(6 + j);
    arrays.lower[torque] = -phase.torque_nm[j] - sample.h(6 + j);
    const double q = sample.q(7 + j), v = sample.v(6 + j), speed = phase.velocity_rad_s[j];
    const double to_upper = phase.upper_rad[j] - q, to_lower = q - phase.lower_rad[j];
    double upper = std::clamp(std::min(k * k * to_upper - 2.0 * k * v, k_v * (speed - v)), -most, most);
    double lower = std::clamp(std::max(-k * k * to_lower - 2.0 * k * v, -k_v * (speed + v)), -most, most);
    if (lower > upper) (to_upper <= to_lower ? lower : upper) = to_upper <= to_lower ? upper : lower;
    arrays.upper[range] = upper;
    arrays.lower[range] = lower;
  }
}

}  // namespace

std::array<double, 3> rotation_error(const View& reference, const View& actual) {
  double R[3][3] = {};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      for (std::size_t k = 0; k < 3; ++k) R[i][j] += reference(i, k) * actual(j, k);
    }
  }
  // the quaternion by its largest component (Shepperd 1978)
  const double trace = R[0][0] + R[1][1] + R[2][2];
  double w = 0.0;
  Vector x{};
  if (trace >= std::max({R[0][0], R[1][1], R[2][2]})) {
    w = 1.0 + trace;
    x = {R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]};
  } else {
    const std::size_t i = R[0][0] >= R[1][1] ? (R[0][0] >= R[2][2] ? 0 : 2) : (R[1][1] >= R[2][2] ? 1 : 2);
    const std::size_t j = (i + 1) % 3, k = (j + 1) % 3;
    w = R[k][j] - R[j][k];
    x[i] = 1.0 + R[i][i] - R[j][j] - R[k][k];
    x[j] = R[j][i] + R[i][j];
    x[k] = R[k][i] + R[i][k];
  }
  const double sine = std::sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
  // 2 atan(sine / w) / sine, the angle over the length; the sign of the quaternion keeps the angle below pi
  const double sign = w < 0.0 ? -1.0 : 1.0;
  const double scale = sine > 1e-9 * std::abs(w) ? 2.0 * std::atan2(sine, std::abs(w)) / sine : 2.0 / std::abs(w);
  for (double& component : x) component *= sign * scale;
  return x;
}

std::size_t fill_body_rows(const BodyPhase& phase, const BodySample& sample, const BodyArrays& arrays) {
  fill_equalities(phase, sample, arrays);
  fill_bounds(phase, sample, arrays);
  fill_force_columns(phase, sample, arrays);
  return fill_level_2(phase, sample, arrays);
}

}  // namespace stridelab
