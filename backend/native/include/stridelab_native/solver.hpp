// min (4.20a) over motions on given contacts: primal-dual interior points on the exact cones.
//
// Steps are Mehrotra's (an affine step, then a centred and corrected one) as long as the first-order conditions make
// progress over a few iterations. Where they do not, the barrier parameter is held and plain Newton steps must decrease
// the merit function, which descends along them because the curvature is positive definite, until they do again.
#pragma once
#include <vector>

#include "stridelab_native/evaluate.hpp"
#include "stridelab_native/iterate.hpp"

namespace stridelab {

inline constexpr double objective_scale = 1e-2;  // that of the CasADi programme: the same tolerance means the same

struct Settings {
  int iterations = 100;
  double seconds = 10.0;    // of the process, looked at after every iteration
  double tolerance = 1e-6;  // of the conditions, dual ones times `objective_scale`
  double gap = 1e-6;        // of the objective, as a share of it
  double barrier = 1.0;     // mu at a cold start
  bool warm = false;        // begin where the iterate stands
};

struct Entry {
  double cost, feasibility, stationarity, mu, primal_step, dual_step, theta, guarded;
};

enum class Verdict { solved, out_of_iterations, out_of_time, not_finite, stalled, infeasible };

struct Report {
  Verdict verdict = Verdict::out_of_iterations;
  int iterations = 0;
  double cost = 0.0;
  Conditions conditions{};
  std::size_t stage = 0;  // where an infeasible problem asks too much
  std::vector<Entry> log;
};

// The thesis' own start: a straight CoM, at rest, the weight shared by the points.
void cold_start(const Problem& problem, Iterate& it, double barrier);

// Slacks of all bounds as they are, or a little of it, with multipliers of a barrier; after `evaluate`.
void loosen(Iterate& it, double barrier);

// Free lengths are freed near the solution for those given. Where that fails: forces that reach the end at all are
// sought, without the cost, and the solve begins anew from them.
Report solve(const Problem& problem, Iterate& it, const Settings& settings);

}  // namespace stridelab
