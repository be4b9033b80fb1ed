// min (4.20a) over motions on given contacts: primal-dual interior-point method on the exact cones.
//
// Mehrotra steps (an affine step, then a centred and corrected one) are used while the first-order conditions make
// progress over a few iterations. Otherwise the barrier parameter is fixed and plain Newton steps must decrease the
// merit function, for which they are descent directions because the Hessian is positive definite.
#pragma once
#include <vector>

#include "stridelab_native/evaluate.hpp"
#include "stridelab_native/iterate.hpp"

namespace stridelab {

inline constexpr double objective_scale = 1e-2;  // that of the CasADi nonlinear program, so that tolerances agree

struct Settings {
  int iterations = 100;
  double seconds = 10.0;    // processor time, checked after every iteration
  double tolerance = 1e-6;  // of the conditions, dual ones times `objective_scale`
  double gap = 1e-6;        // of the objective, as a share of it
  double barrier = 1.0;     // mu at a cold start
  bool warm = false;        // start from the current iterate
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
  std::size_t stage = 0;  // of the largest violation of an infeasible problem
  std::vector<Entry> log;
};

// Initial guess of the thesis: a straight CoM path, zero velocity, the weight shared by the points.
void cold_start(const Problem& problem, Iterate& it, double barrier);

// Initialise the slacks of all bounds to their values, at least a small positive one, with barrier multipliers; call
// after `evaluate`.
void initialise_slacks(Iterate& it, double barrier);

// Lengths and contacts become variables near the solution with fixed ones. If that solve fails, forces that reach the
// end are computed without the cost, and the solve restarts from them.
Report solve(const Problem& problem, Iterate& it, const Settings& settings);

}  // namespace stridelab
