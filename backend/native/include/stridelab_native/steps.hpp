// Along a direction: how far the cones allow, what is left of u^T z, whether the merit function descends.
#pragma once
#include "stridelab_native/newton.hpp"

namespace stridelab {

struct Steps {
  double primal, dual;
};

// Targets of the next direction: u o z = mu e, with the second-order term of the last direction where `corrected`.
void aim(Iterate& it, double mu, bool corrected);

Steps longest_steps(const Iterate& it);

// Sum of u^T z after a step.
double complementarity_after(const Iterate& it, Steps by);

// x, u by the primal step, z by the dual one.
void move(Iterate& it, Steps by);

// M = cost - mu / 2 sum log det u + weight |c|_1 with c the gaps and the misses of the end.
struct Merit {
  double barrier;    // cost - mu / 2 sum log det u
  double violation;  // |c|_1
  double slope;      // of the barrier part along the direction
};

Merit merit(const Problem& problem, const Iterate& it, double cost, double mu);

// Of the dynamics, between intervals.
double largest_gap(const Iterate& it);

// States that the forces lead to from the first one: no gaps are left but at the end.
void lead_states(Iterate& it);

// z back to mu u^-1 where it has lost all relation to it.
void tame(Iterate& it, double mu);

}  // namespace stridelab
