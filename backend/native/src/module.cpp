// Python binding: flat arrays in and out; the solver itself is independent of Python.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>

#include <cmath>
#include <memory>
#include <string>

#include "body_module.hpp"
#include "stridelab_native/solver.hpp"
#include "stridelab_native/splines.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace stridelab;

namespace {

template <typename T, int n>
using Array = nb::ndarray<const T, nb::ndim<n>, nb::c_contig, nb::device::cpu>;
using Reals1 = Array<double, 1>;
using Reals2 = Array<double, 2>;
using Reals3 = Array<double, 3>;
using Ints1 = Array<std::int32_t, 1>;
using Ints2 = Array<std::int32_t, 2>;

void require(bool wrench_controls, const char* what) {
  if (!wrench_controls) throw nb::value_error(what);
}

template <typename A>
void finite(const A& a, const char* what) {
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!std::isfinite(a.data()[i])) throw nb::value_error((std::string(what) + " must be numbers").c_str());
  }
}

template <typename T>
nb::object array(std::vector<T> values, std::initializer_list<std::size_t> shape) {
  auto* kept = new std::vector<T>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, T>(kept->data(), shape, owner));
}

Density density(const Reals1& constants, const Reals2& means, const Reals3& whitenings) {
  const std::size_t n = constants.size();
  require(n > 0 && n <= 8 * eights_max, "a mixture has between 1 and 64 components");
  require(means.shape(0) == n && means.shape(1) == 3, "means have the shape (components, 3)");
  require(whitenings.shape(0) == n && whitenings.shape(1) == 3 && whitenings.shape(2) == 3,
          "whitenings have the shape (components, 3, 3)");
  finite(constants, "constants of a mixture");
  finite(means, "means of a mixture");
  finite(whitenings, "whitenings of a mixture");
  Density d;
  d.eights.resize((n + 7) / 8);
  for (auto& e : d.eights) {
    e = Density::Eight{};
    e.constant = splat8(-1e300);
  }
  for (std::size_t j = 0; j < n; ++j) {
    Density::Eight& e = d.eights[j / 8];
    const std::size_t lane = j % 8;
    e.constant[lane] = constants(j);
    for (std::size_t i = 0; i < 3; ++i) e.mean[i][lane] = means(j, i);
    int at = 0;
    for (std::size_t r = 0; r < 3; ++r) {
      for (std::size_t c = 0; c <= r; ++c) e.W[at++][lane] = whitenings(j, r, c);
    }
    at = 0;
    for (std::size_t r = 0; r < 3; ++r) {
      for (std::size_t c = r; c < 3; ++c) {
        double P = 0.0;
        for (std::size_t k = 0; k < 3; ++k) P += whitenings(j, k, r) * whitenings(j, k, c);
        e.precision[at++][lane] = P;
      }
    }
  }
  return d;
}

// A problem with its iterate; a further solve starts from the last iterate.
struct ProblemState {
  Problem problem;
  Iterate iterate;
};

std::unique_ptr<ProblemState> build(const Reals1& weights, const Reals1& start, const Reals1& goal,
                                    const nb::list& densities, const Ints1& visit_density, const Reals2& visit_place,
                                    const Reals3& visit_axes, const Reals3& block_S, const Reals3& block_points,
                                    const Ints1& block_count, const Reals2& block_effort, const Reals1& block_most,
                                    const Ints2& phase_layout, const Reals1& phase_h, const Reals2& heights, int end,
                                    const Reals2& planes, const Reals3& wrench_cones, const Ints1& phase_cone,
                                    const Reals1& length_limits, const Ints2& block_edges, bool cubic,
                                    const Ints2& places, const Reals3& place_axes, const Reals2& place_windows,
                                    const Ints1& block_place, const Ints1& visit_place_of, const Reals2& limbs,
                                    const Reals2& reference) {
  auto held = std::make_unique<ProblemState>();
  Problem& p = held->problem;
  require(weights.size() == 3, "weights are those of acceleration, momentum rate and likelihood");
  require(start.size() == nx && goal.size() == nx, "start and goal have nine entries");
  finite(weights, "weights");
  finite(start, "start");
  finite(goal, "goal");
  p.w_acceleration = weights(0);
  p.w_momentum = weights(1);
  p.w_likelihood = weights(2);
  for (std::size_t i = 0; i < nx; ++i) {
    p.start[i] = start(i);
    p.goal[i] = goal(i);
  }
  for (const auto& of : densities) {
    const auto parts = nb::cast<nb::tuple>(of);
    require(parts.size() == 3, "a mixture is (constants, means, whitenings)");
    p.densities.push_back(density(nb::cast<Reals1>(parts[0]), nb::cast<Reals2>(parts[1]), nb::cast<Reals3>(parts[2])));
  }
  require(places.shape(1) == 2 && place_axes.shape(0) == places.shape(0) && place_axes.shape(1) == 2 &&
              place_axes.shape(2) == 3 && place_windows.shape(0) == places.shape(0) && place_windows.shape(1) == 4,
          "places have their phases (2), axes (2, 3) and a window (4)");
  finite(place_axes, "axes of places");
  finite(place_windows, "windows");
  const int n_places = static_cast<int>(places.shape(0));
  for (std::size_t i = 0; i < places.shape(0); ++i) {
    Place at{};
    at.first_phase = places(i, 0);
    at.last_phase = places(i, 1);
    for (std::size_t a = 0; a < 2; ++a) {
      for (std::size_t c = 0; c < 3; ++c) at.axes[a][c] = place_axes(i, a, c);
      at.low[a] = place_windows(i, 2 * a);
      at.high[a] = place_windows(i, 2 * a + 1);
      require(at.low[a] <= 0.0 && at.high[a] >= 0.0 && at.low[a] < at.high[a], "windows hold where contacts are");
    }
    require(at.first_phase >= 0 && at.last_phase >= at.first_phase &&
                at.last_phase < static_cast<int>(phase_h.size()) &&
                (p.places.empty() || p.places.back().last_phase <= at.last_phase),
            "places are in the order of their last phases");
    p.places.push_back(at);
  }
  require(p.places.empty() || length_limits.size() == 0, "lengths and places are not free at once");
  for (int f = 0; f < static_cast<int>(phase_h.size()); ++f) {
    int at_once = 0;
    for (const Place& at : p.places) at_once += at.first_phase <= f && f <= at.last_phase;
    require(2 * at_once <= shares_max, "no more than four contacts of a phase are moved");
  }
  const std::size_t n_visits = visit_density.size();
  require(visit_place_of.size() == n_visits && block_place.size() == block_count.size(),
          "blocks and visits name places");
  require(visit_place.shape(0) == n_visits && visit_place.shape(1) == 3 && visit_axes.shape(0) == n_visits &&
              visit_axes.shape(1) == 3 && visit_axes.shape(2) == 3,
          "visits have a density, a place (3) and axes (3, 3)");
  finite(visit_place, "places");
  finite(visit_axes, "axes");
  for (std::size_t i = 0; i < n_visits; ++i) {
    Visit v{};
    v.density = visit_density(i);
    require(v.density >= 0 && static_cast<std::size_t>(v.density) < p.densities.size(), "a visit names its density");
    for (std::size_t r = 0; r < 3; ++r) {
      v.place[r] = visit_place(i, r);
      for (std::size_t c = 0; c < 3; ++c) v.R[3 * r + c] = visit_axes(i, r, c);
    }
    v.moved = visit_place_of(i);
    require(v.moved >= -1 && v.moved < n_places, "places of visits exist");
    p.visits.push_back(v);
  }
  const std::size_t n_blocks = block_count.size();
  require(block_S.shape(0) == n_blocks && block_S.shape(1) == 3 && block_S.shape(2) == 3 &&
              block_points.shape(0) == n_blocks && block_points.shape(1) == 4 && block_points.shape(2) == 3 &&
              block_effort.shape(0) == n_blocks && block_effort.shape(1) == 2,
          "blocks have S (3, 3), points (4, 3) and two weights");
  require(block_edges.shape(0) == n_blocks && block_edges.shape(1) == 2, "blocks come and go, or stay");
  require(block_most.size() == n_blocks, "blocks have a bound on their normal forces");
  finite(block_S, "frames of contacts");
  finite(block_points, "contact points");
  finite(block_effort, "weights of forces");
  for (std::size_t i = 0; i < n_blocks; ++i) {
    Block b{};
    b.points = block_count(i);
    require(b.points >= 1 && b.points <= 4, "a block has one to four points");
    for (std::size_t r = 0; r < 3; ++r) {
      for (std::size_t c = 0; c < 3; ++c) b.S[3 * r + c] = block_S(i, r, c);
      for (std::size_t j = 0; j < 4; ++j)
        b.p[r][j] = j < static_cast<std::size_t>(b.points) ? block_points(i, j, r) : 0.0;
    }
    for (int j = 0; j < 4; ++j) b.real[j] = j < b.points ? 1.0 : 0.0;
    b.effort[0] = block_effort(i, 0);
    b.effort[1] = block_effort(i, 1);
    b.normal_max = block_most(i);
    require(b.normal_max > 0.0, "bounds on normal forces are positive");
    b.comes = block_edges(i, 0) != 0;
    b.goes = block_edges(i, 1) != 0;
    b.moved = block_place(i);
    require(b.moved >= -1 && b.moved < n_places, "places of blocks exist");
    p.blocks.push_back(b);
  }
  require(length_limits.size() == 0 || length_limits.size() == 4, "freedom is shortest, longest, total and price");
  if (length_limits.size() == 4) {
    p.length_limits = {true, length_limits(0), length_limits(1), length_limits(2), length_limits(3)};
    require(length_limits(0) > 0.0 && length_limits(0) <= 1.0 && length_limits(1) >= 1.0 &&
                length_limits(0) < length_limits(1) && std::isfinite(length_limits(1) + length_limits(3)) &&
                length_limits(2) > 0.0 && length_limits(3) >= 0.0,
            "free lengths lie around those given");
  }
  p.shape = cubic ? Shape::cubic : Shape::constant;
  require(!cubic || length_limits.size() == 0, "of splines the lengths are given");
  require(phase_layout.shape(0) == phase_h.size() && phase_layout.shape(1) == 5 && phase_h.size() > 0,
          "phases have (intervals, first block, blocks, first visit, visits) and a length of interval");
  finite(phase_h, "lengths of intervals");
  require(planes.shape(1) == 5, "planes have a normal (4) and an offset");
  finite(planes, "planes");
  constexpr End ends[] = {End::rest, End::capturable, End::moving};
  require(end >= 0 && end < 3, "an end is at rest (0), capturable (1) or moving (2)");
  p.end = ends[end];
  for (std::size_t i = 0; i < planes.shape(0); ++i) {
    p.planes.push_back({{planes(i, 0), planes(i, 1), planes(i, 2), planes(i, 3)}, planes(i, 4)});
  }
  require(wrench_cones.shape(1) == nw && wrench_cones.shape(2) == nw, "wrench cones have the shape (6, 6)");
  finite(wrench_cones, "wrench cones");
  for (std::size_t i = 0; i < wrench_cones.shape(0); ++i) {
    WrenchCone cone{};
    for (std::size_t r = 0; r < nw; ++r) {
      for (std::size_t c = 0; c < nw; ++c) cone.G[r][c] = wrench_cones(i, r, c);
    }
    p.cones.push_back(cone);
  }
  require(phase_cone.size() == phase_h.size(), "phases name their wrench cones");
  std::size_t intervals = 0;
  for (std::size_t i = 0; i < phase_h.size(); ++i) {
    Phase f{};
    f.intervals = phase_layout(i, 0);
    f.first_block = phase_layout(i, 1);
    f.blocks = phase_layout(i, 2);
    f.first_visit = phase_layout(i, 3);
    f.visits = phase_layout(i, 4);
    f.h = phase_h(i);
    require(!cubic || f.intervals % 2 == 0, "an interval has two control points of splines");
    require(f.intervals > 0 && f.h > 0.0, "every phase takes some time");
    require(f.first_block >= 0 && f.blocks >= 0 && static_cast<std::size_t>(f.first_block + f.blocks) <= n_blocks,
            "blocks of a phase exist");
    require(f.first_visit >= 0 && f.visits >= 0 && static_cast<std::size_t>(f.first_visit + f.visits) <= n_visits,
            "visits of a phase exist");
    f.cone = phase_cone(i);
    require(f.cone >= -1 && f.cone < static_cast<int>(p.cones.size()), "wrench cones of a phase exist");
    require(!cubic || f.cone < 0, "splines are of forces");
    intervals += static_cast<std::size_t>(f.intervals);
    p.phases.push_back(f);
  }
  require(heights.shape(1) == 2 && (heights.shape(0) == 0 || heights.shape(0) == intervals),
          "intervals have bounds on the height");
  for (std::size_t k = 0; k < heights.shape(0); ++k) {
    require(heights(k, 0) < heights(k, 1) && std::isfinite(heights(k, 0)) == std::isfinite(heights(k, 1)),
            "bounds on heights leave something, and both or none are finite");
    p.heights.push_back({heights(k, 0), heights(k, 1)});
  }
  const std::size_t rates = cubic ? intervals / 2 * n_gauss : intervals;
  require(limbs.shape(1) == 3 && (limbs.shape(0) == 0 || limbs.shape(0) == rates), "limbs have a rate per interval");
  require(limbs.shape(0) == 0 || (length_limits.size() == 0 && n_places == 0), "limbs move on a given grid");
  finite(limbs, "rates of the limbs");
  p.limbs.assign(limbs.data(), limbs.data() + limbs.size());
  require(reference.shape(1) == 3 && (reference.shape(0) == 0 || reference.shape(0) == rates),
          "the reference has an acceleration per interval");
  require(reference.shape(0) == 0 || length_limits.size() == 0, "a reference is on a given grid");
  finite(reference, "accelerations of the reference");
  p.reference.assign(reference.data(), reference.data() + reference.size());
  return held;
}

template <typename A>
bool shaped(const A& a, std::initializer_list<std::size_t> shape) {
  std::size_t i = 0;
  for (std::size_t size : shape) {
    if (a.shape(i++) != size) return false;
  }
  return true;
}

void require_inside(double u_across, double u_head, double z_across, double z_head) {
  require(u_across < u_head && z_across < z_head, "forces and multipliers of a start lie inside their cones");
}

// Set a start: states, forces and multipliers in the order of the blocks, wrenches in that of the intervals. Returns
// false and changes nothing if the sizes do not match.
bool begin(ProblemState& held, const Reals2& x, const Reals3& u, const Reals3& z, const Reals2& wrench_u,
           const Reals2& wrench_z, const Reals1& phase_h) {
  Iterate& it = held.iterate;
  cold_start(held.problem, it, 1.0);
  if (!shaped(x, {it.stages.size(), nx}) || !shaped(u, {it.contact_blocks.size(), 4, 3}) ||
      !shaped(z, {it.contact_blocks.size(), 4, 3}) || !shaped(wrench_u, {it.wrench_controls.size(), nw}) ||
      !shaped(wrench_z, {it.wrench_controls.size(), nw}) || phase_h.size() != held.problem.phases.size()) {
    return false;
  }
  finite(x, "states of a start");
  finite(u, "forces of a start");
  finite(z, "multipliers of a start");
  finite(wrench_u, "wrenches of a start");
  finite(wrench_z, "multipliers of wrenches of a start");
  finite(phase_h, "lengths of a start");
  for (Stage& s : it.stages) {
    if (s.phase == nullptr || !held.problem.length_limits.lengths) continue;
    s.h = phase_h(static_cast<std::size_t>(s.phase - held.problem.phases.data()));
    require(s.h > 0.0, "lengths of a start are positive");
  }
  for (std::size_t k = 1; k < it.stages.size(); ++k) {
    for (std::size_t i = 0; i < nx; ++i) it.stages[k].x[i] = x(k, i);
  }
  for (std::size_t s = 0; s < it.contact_blocks.size(); ++s) {
    ContactBlock& t = it.contact_blocks[s];
    for (std::size_t j = 0; j < static_cast<std::size_t>(t.block->points); ++j) {
      for (std::size_t i = 0; i < 3; ++i) {
        t.at.u[i][j] = u(s, j, i);
        t.at.z[i][j] = z(s, j, i);
      }
      require_inside(std::hypot(u(s, j, 0), u(s, j, 1)), u(s, j, 2), std::hypot(z(s, j, 0), z(s, j, 1)), z(s, j, 2));
    }
  }
  for (std::size_t s = 0; s < it.wrench_controls.size(); ++s) {
    auto& at = it.wrench_controls[s].at;
    for (std::size_t i = 0; i < nw; ++i) {
      at.u[i] = wrench_u(s, i);
      at.z[i] = wrench_z(s, i);
    }
    require_inside(root(across(at.u, at.u)), at.u[nw - 1], root(across(at.z, at.z)), at.z[nw - 1]);
  }
  return true;
}

nb::dict run(ProblemState& held, int iterations, double seconds, double tolerance, double gap, bool warm) {
  Settings settings;
  settings.iterations = iterations;
  settings.seconds = seconds;
  settings.tolerance = tolerance;
  settings.gap = gap;
  settings.warm = warm;
  Report report;
  double cpu = 0.0;
  {
    nb::gil_scoped_release free;
    timespec a{}, b{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
    report = solve(held.problem, held.iterate, settings);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
    cpu = static_cast<double>(b.tv_sec - a.tv_sec) + 1e-9 * static_cast<double>(b.tv_nsec - a.tv_nsec);
  }
  const Iterate& it = held.iterate;
  std::vector<double> x, u, z, wrench_u, wrench_z, phase_h, log;
  for (const Stage& s : it.stages) x.insert(x.end(), s.x, s.x + nx);
  for (const auto& t : it.contact_blocks) {
    for (int j = 0; j < 4; ++j) {
      for (int i = 0; i < 3; ++i) {
        u.push_back(t.at.u[i][j]);
        z.push_back(t.at.z[i][j]);
      }
    }
  }
  for (const Phase& f : held.problem.phases) phase_h.push_back(f.h);
  for (std::size_t i = 0; i < it.lengths.size(); ++i) phase_h[i] = it.lengths[i].h;
  for (const WrenchControl& hold : it.wrench_controls) {
    wrench_u.insert(wrench_u.end(), hold.at.u, hold.at.u + nw);
    wrench_z.insert(wrench_z.end(), hold.at.z, hold.at.z + nw);
  }
  for (const Entry& e : report.log) {
    for (double value : {e.cost, e.feasibility, e.stationarity, e.mu, e.primal_step, e.dual_step, e.theta, e.guarded})
      log.push_back(value);
  }
  nb::dict d;
  d["verdict"] = static_cast<int>(report.verdict);
  d["iterations"] = report.iterations;
  d["cost"] = report.cost;
  d["stationarity"] = report.conditions.stationarity;
  d["feasibility"] = report.conditions.feasibility;
  d["complementarity"] = report.conditions.complementarity;
  d["gap"] = report.conditions.gap;
  d["stage"] = report.stage;
  d["cpu_s"] = cpu;
  const std::size_t n = it.stages.size(), m = it.contact_blocks.size(), l = report.log.size();
  d["x"] = array(std::move(x), {n, static_cast<std::size_t>(nx)});
  d["u"] = array(std::move(u), {m, 4, 3});
  d["z"] = array(std::move(z), {m, 4, 3});
  d["wrench_u"] = array(std::move(wrench_u), {it.wrench_controls.size(), static_cast<std::size_t>(nw)});
  d["wrench_z"] = array(std::move(wrench_z), {it.wrench_controls.size(), static_cast<std::size_t>(nw)});
  std::vector<double> shift(2 * held.problem.places.size(), 0.0);
  for (std::size_t i = 0; i < it.shifts.size(); ++i) std::copy(it.shifts[i].d, it.shifts[i].d + 2, &shift[2 * i]);
  d["shift"] = array(std::move(shift), {held.problem.places.size(), 2});
  d["phase_h"] = array(std::move(phase_h), {held.problem.phases.size()});
  d["log"] = array(std::move(log), {l, 8});
  return d;
}

}  // namespace

NB_MODULE(_native, module) {
  module.attr("__version__") = "0.1.0";
  module.attr("INTERFACE") = 8;
  nb::class_<ProblemState>(module, "Problem")
      .def("begin", &begin, "x"_a, "u"_a, "z"_a, "wrench_u"_a, "wrench_z"_a, "phase_h"_a)
      .def("solve", &run, "iterations"_a, "seconds"_a, "tolerance"_a, "gap"_a, "warm"_a);
  module.def("problem", &build);
  bind_body(module);
}
