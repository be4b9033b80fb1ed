// Python binding of the rows of the whole body: arrays of numpy are read and filled in place.
#include "stridelab_native/body_rows.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "arrays.hpp"
#include "body_module.hpp"
#include "stridelab_native/avoidance.hpp"
#include "stridelab_native/reduced_level.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace stridelab {

namespace {

std::vector<double> numbers(nb::handle given, std::size_t n, const char* what) {
  const View v = view(given, n, 0, what);
  std::vector<double> copy(n);
  for (std::size_t i = 0; i < n; ++i) copy[i] = v(i);
  return copy;
}

Gain gain(nb::handle given) {
  const auto pair = nb::cast<nb::tuple>(given);
  return {nb::cast<double>(pair[0]), nb::cast<double>(pair[1])};
}

BodyContact contact(nb::handle given) {
  const auto fields = nb::cast<nb::tuple>(given);
  BodyContact made;
  made.surface = nb::cast<bool>(fields[0]);
  made.gain = gain(fields[1]);
  const View position = view(fields[2], 3, 0, "positions of contacts have the shape (3,)");
  const View rotation = view(fields[3], 3, 3, "rotations of contacts have the shape (3, 3)");
  const auto points = nb::cast<Input>(fields[4]);
  require(points.ndim() == 2, "points have the shape (k, 3)");
  const View at = view(fields[4], points.shape(0), 3, "points have the shape (k, 3)");
  for (std::size_t i = 0; i < 3; ++i) {
    made.position[i] = position(i);
    for (std::size_t j = 0; j < 3; ++j) made.rotation[3 * i + j] = rotation(i, j);
  }
  for (std::size_t p = 0; p < points.shape(0); ++p) made.points.push_back({at(p, 0), at(p, 1), at(p, 2)});
  return made;
}

// The rows of one phase; the arrays that are filled are held with it.
class BodyRows {
public:
  BodyRows(nb::list contacts, std::vector<bool> swings_surface, nb::dict joints, nb::dict settings, nb::list arrays,
           std::size_t torque_row)
      : torque_row_(torque_row) {
    for (const nb::handle one : contacts) phase_.contacts.push_back(contact(one));
    phase_.swings_surface = std::move(swings_surface);
    const std::size_t na = nb::len(nb::handle(joints["rest_rad"])), nf = nb::len(nb::handle(joints["force_weight"]));
    const auto per_joint = [&](const char* name) { return numbers(joints[name], na, "one number per joint"); };
    phase_.lower_rad = per_joint("lower_rad");
    phase_.upper_rad = per_joint("upper_rad");
    phase_.velocity_rad_s = per_joint("velocity_rad_s");
    phase_.torque_nm = per_joint("torque_nm");
    phase_.rest_rad = per_joint("rest_rad");
    phase_.posture_weight = per_joint("posture_weight");
    phase_.force_weight = numbers(joints["force_weight"], nf, "one weight per force");
    phase_.ankles = nb::cast<std::vector<std::size_t>>(joints["ankles"]);
    for (const std::size_t column : phase_.ankles) require(column >= 6 && column < 6 + na, "ankles are joints");
    phase_.com = gain(settings["com"]);
    phase_.effector = gain(settings["effector"]);
    phase_.base = gain(settings["base"]);
    phase_.posture = gain(settings["posture"]);
    phase_.hand = gain(settings["hand"]);
    phase_.ankle = gain(settings["ankle"]);
    const auto number = [&](const char* name) { return nb::cast<double>(settings[name]); };
    phase_.mass_kg = number("mass_kg");
    phase_.momentum_weight = number("momentum_weight");
    phase_.momentum_per_s = number("momentum_per_s");
    phase_.base_weight = number("base_weight");
    phase_.hand_weight = number("hand_weight");
    phase_.ankle_weight = number("ankle_weight");
    phase_.ankle_acts_rad = number("ankle_acts_rad");
    phase_.ankle_ahead_s = number("ankle_ahead_s");
    phase_.barrier_per_s = number("barrier_per_s");
    phase_.velocity_rate_per_s = number("velocity_rate_per_s");
    phase_.acceleration_rad_s2 = number("acceleration_rad_s2");

    std::size_t points = 0, fixed = 6 + 3, free = 3 + 3 + na + phase_.ankles.size() + nf;
    for (const BodyContact& one : phase_.contacts) {
      points += one.points.size();
      fixed += one.surface ? 6 : 3;
      free += one.surface ? 0 : 3;
    }
    for (const bool surface : phase_.swings_surface) {
      fixed += surface ? 6 : 3;
      free += surface ? 0 : 3;
    }
    require(nf == 3 * points, "three weights of forces per point");
    require(nb::len(arrays) == 7, "seven arrays are filled");
    for (const nb::handle one : arrays) held_.push_back(nb::cast<Output>(one, false));
    const std::size_t nz = phase_.unknowns(), bounds = held_[5].size();
    require(held_[0].size() == fixed * nz && held_[1].size() == fixed, "rows of levels 0 and 1");
    require(held_[3].size() >= free && held_[2].size() == held_[3].size() * nz, "rows of level 2");
    require(held_[4].size() == bounds * nz && held_[6].size() == bounds && torque_row + 2 * na == bounds,
            "rows of the inequalities");
    spare_ = held_[3].size() - free;
  }

  // ``state``: q, v, M, h, A_g, A_g_drift, com, com_v, l; ``frames``: position, rotation, J, velocity, drift of each;
  // ``reference``: com, com_v, com_a, l, l_rate; ``base``: rotation, angular velocity and acceleration; ``swings``:
  // position, velocity, acceleration, rotation, angular velocity and acceleration of each; ``avoid``: A, b, weights.
  std::size_t fill(nb::tuple state, nb::list frames, nb::tuple reference, nb::tuple base, nb::list swings,
                   nb::handle planned_n, nb::tuple avoid) {
    const std::size_t na = phase_.joints(), nv = 6 + na;
    const char* const shape = "the state of the body has another shape";
    BodySample s;
    require(nb::len(state) == 9 && nb::len(reference) == 5 && nb::len(base) == 3 && nb::len(avoid) == 3, shape);
    s.q = view(state[0], nv + 1, 0, shape);
    s.v = view(state[1], nv, 0, shape);
    s.M = view(state[2], nv, nv, shape);
    s.h = view(state[3], nv, 0, shape);
    s.A_g = view(state[4], 6, nv, shape);
    s.A_g_drift = view(state[5], 6, 0, shape);
    s.com = view(state[6], 3, 0, shape);
    s.com_v = view(state[7], 3, 0, shape);
    s.l = view(state[8], 3, 0, shape);
    require(nb::len(frames) == phase_.contacts.size() + phase_.swings_surface.size() + 1, "one frame per effector");
    for (const nb::handle one : frames) {
      const auto fields = nb::cast<nb::tuple>(one);
      require(nb::len(fields) == 5, "a frame has five fields");
      s.frames.push_back({view(fields[0], 3, 0, shape), view(fields[1], 3, 3, shape), view(fields[2], 6, nv, shape),
                          view(fields[3], 6, 0, shape), view(fields[4], 6, 0, shape)});
    }
    View* const references[5] = {&s.com_ref, &s.com_v_ref, &s.com_a_ref, &s.l_ref, &s.l_rate_ref};
    for (std::size_t i = 0; i < 5; ++i) *references[i] = view(reference[i], 3, 0, "references have the shape (3,)");
    s.base_rotation = view(base[0], 3, 3, "the base's rotation has the shape (3, 3)");
    s.base_w = view(base[1], 3, 0, "the base's rates have the shape (3,)");
    s.base_w_rate = view(base[2], 3, 0, "the base's rates have the shape (3,)");
    require(nb::len(swings) == phase_.swings_surface.size(), "one target per swing");
    for (const nb::handle one : swings) {
      const auto fields = nb::cast<nb::tuple>(one);
      require(nb::len(fields) == 6, "a target has six fields");
      const char* const wrong = "targets have vectors (3,) and a rotation (3, 3)";
      s.swings.push_back({view(fields[0], 3, 0, wrong), view(fields[1], 3, 0, wrong), view(fields[2], 3, 0, wrong),
                          view(fields[3], 3, 3, wrong), view(fields[4], 3, 0, wrong), view(fields[5], 3, 0, wrong)});
    }
    s.planned_n = view(planned_n, phase_.forces(), 0, "three numbers per point");
    s.avoid_rows = nb::len(nb::handle(avoid[1]));
    require(s.avoid_rows <= spare_, "too many rows of the avoidance");
    s.avoid_A = view(avoid[0], s.avoid_rows, nv, "the avoidance has a row per pair");
    s.avoid_b = view(avoid[1], s.avoid_rows, 0, "the avoidance has a row per pair");
    s.avoid_weight = view(avoid[2], s.avoid_rows, 0, "the avoidance has a row per pair");
    return fill_body_rows(phase_, s,
                          {held_[0].data(), held_[1].data(), held_[2].data(), held_[3].data(), held_[4].data(),
                           held_[5].data(), held_[6].data(), torque_row_});
  }

private:
  BodyPhase phase_;
  std::vector<Output> held_;
  std::size_t torque_row_, spare_ = 0;
};

// The pairs of one robot on one terrain; the arrays that are filled are held with them.
class AvoidanceRows {
public:
  AvoidanceRows(nb::handle sign, nb::handle moving, nb::handle scale, std::vector<bool> moves_target, nb::dict settings,
                nb::list arrays) {
    const auto signs = nb::cast<Input>(sign, false);
    require(signs.ndim() == 2, "signs have the shape (n, nv)");
    const std::size_t n = signs.shape(0);
    pairs_.nv = signs.shape(1);
    for (const auto& [given, copy] : {std::pair{sign, &pairs_.sign}, std::pair{moving, &pairs_.moving}}) {
      const View table = view(given, n, pairs_.nv, "tables have a row per pair");
      for (std::size_t i = 0; i < n * pairs_.nv; ++i) copy->push_back(table(i / pairs_.nv, i % pairs_.nv));
    }
    pairs_.scale = numbers(scale, n, "one scale per pair");
    require(moves_target.size() == n, "one flag per pair");
    pairs_.moves_target = std::move(moves_target);
    const auto number = [&](const char* name) { return nb::cast<double>(settings[name]); };
    pairs_.gains = {number("apart_m"), number("acts_m"),  number("kp"),          number("kd"),    number("weight"),
                    number("firmest"), number("lever_m"), number("short_lever"), number("urgent")};
    require(nb::len(arrays) == 6, "six arrays are filled");
    for (const nb::handle one : arrays) held_.push_back(nb::cast<Output>(one, false));
    most_ = held_[1].size();
    require(held_[0].size() == 3 * most_ && held_[2].size() == most_ && held_[3].size() == most_ * pairs_.nv &&
                held_[4].size() == most_ && held_[5].size() == most_,
            "the arrays have a row per near pair");
  }

  // The number of rows of tasks.
  std::size_t fill(std::vector<std::size_t> pair, nb::handle distance, nb::handle p_1, nb::handle p_2, nb::handle J,
                   nb::handle v) {
    const std::size_t m = pair.size();
    require(m <= most_, "too many near pairs");
    for (const std::size_t k : pair) require(k < pairs_.scale.size(), "no such pair");
    const char* const shape = "near pairs have a distance and two points (3,)";
    const NearPairs near{std::move(pair),
                         view(distance, m, 0, shape),
                         view(p_1, m, 3, shape),
                         view(p_2, m, 3, shape),
                         view(J, 6, pairs_.nv, "the body's Jacobian has the shape (6, nv)"),
                         view(v, pairs_.nv, 0, "velocities have the shape (nv,)")};
    return fill_avoidance(
        pairs_, near,
        {held_[0].data(), held_[1].data(), held_[2].data(), held_[3].data(), held_[4].data(), held_[5].data()});
  }

private:
  AvoidancePairs pairs_;
  std::vector<Output> held_;
  std::size_t most_ = 0;
};

std::size_t rows_of(nb::handle vector) { return nb::cast<Input>(vector, false).size(); }

LinearRows linear_rows(nb::handle given, std::size_t n) {
  const auto fields = nb::cast<nb::tuple>(given);
  const char* const shape = "rows have a matrix (m, n) and a vector (m,)";
  require(nb::len(fields) == 2, shape);
  const std::size_t m = rows_of(fields[1]);
  return {view(fields[0], m, n, shape), view(fields[1], m, 0, shape), m};
}

// ``above``: (A, b) of each block; ``level``: (A, b); ``bounds``: (G, lower, upper). Writes z, Z, H, f, C, lower and
// upper one after the other into ``values``; the number of columns of Z, or None if the rows above contradict each
// other.
std::optional<std::size_t> reduced_level(nb::sequence above, nb::tuple level, nb::tuple bounds, nb::handle values) {
  const char* const shape = "bounds have a matrix (m, n) and two vectors (m,)";
  require(nb::len(bounds) == 3, shape);
  const auto matrix = nb::cast<Input>(bounds[0], false);
  require(matrix.ndim() == 2, shape);
  const std::size_t n = matrix.shape(1), m = matrix.shape(0);
  std::vector<LinearRows> blocks;
  for (const nb::handle block : above) blocks.push_back(linear_rows(block, n));
  const BoundRows rows{view(bounds[0], m, n, shape), view(bounds[1], m, 0, shape), view(bounds[2], m, 0, shape), m};
  auto written = nb::cast<Output>(values, false);
  require(written.size() >= 2 * n * (n + 1) + m * (n + 2), "too few values for a level of as many unknowns and bounds");
  ReducedLevel made;
  if (!reduce_level(n, blocks, linear_rows(level, n), rows, made)) return {};
  double* next = written.data();
  for (const auto* part : {&made.z, &made.Z, &made.H, &made.f, &made.C, &made.lower, &made.upper}) {
    next = std::copy(part->begin(), part->end(), next);
  }
  return made.k;
}

}  // namespace

void bind_body(nb::module_& module) {
  module.def("reduced_level", &reduced_level, "above"_a, "level"_a, "bounds"_a, "values"_a);
  nb::class_<AvoidanceRows>(module, "AvoidanceRows")
      .def(nb::init<nb::handle, nb::handle, nb::handle, std::vector<bool>, nb::dict, nb::list>(), "sign"_a, "moving"_a,
           "scale"_a, "moves_target"_a, "settings"_a, "arrays"_a)
      .def("fill", &AvoidanceRows::fill, "pair"_a, "distance"_a, "p_1"_a, "p_2"_a, "J"_a, "v"_a);
  nb::class_<BodyRows>(module, "BodyRows")
      .def(nb::init<nb::list, std::vector<bool>, nb::dict, nb::dict, nb::list, std::size_t>(), "contacts"_a,
           "swings_surface"_a, "joints"_a, "settings"_a, "arrays"_a, "torque_row"_a)
      .def("fill", &BodyRows::fill, "state"_a, "frames"_a, "reference"_a, "base"_a, "swings"_a, "planned_n"_a,
           "avoid"_a);
}

}  // namespace stridelab
