// Line search quantities: longest steps in the cones, u^T z after a step, merit function.
#pragma once
#include "stridelab_native/newton.hpp"

namespace stridelab {

struct Steps {
  double primal, dual;
};

// Set the targets of the next direction: u o z = mu e, with the last direction's second-order term if `corrected`.
void set_targets(Iterate& it, double mu, bool corrected);

Steps longest_steps(const Iterate& it);

// Sum of u^T z after a step.
double complementarity_after(const Iterate& it, Steps by);

// x, u by the primal step, z by the dual one.
void move(Iterate& it, Steps by);

// M = cost - mu / 2 sum log det u + weight |c|_1 with c the gaps and the residuals of the end.
struct Merit {
  double barrier;    // cost - mu / 2 sum log det u
  double violation;  // |c|_1
  double slope;      // of the barrier part along the direction
};

Merit merit(const Problem& problem, const Iterate& it, double cost, double mu);

// Largest dynamics gap between intervals.
double largest_gap(const Iterate& it);

// Integrate the states from the first one under the current forces: gaps remain at the end only.
void roll_out_states(Iterate& it);

// Reset z to mu u^-1 where it deviates from it by orders of magnitude.
void reset_multipliers(Iterate& it, double mu);

}  // namespace stridelab
