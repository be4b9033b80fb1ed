// The cost of (4.20a) with our regularisers at a point, its derivatives and the gaps of the dynamics.
#pragma once
#include "stridelab_native/iterate.hpp"

namespace stridelab {

// Fills w, m, gap, q, r and bend of every stage; returns the cost.
double evaluate(const Problem& problem, Iterate& it);

struct Conditions {
  double stationarity;     // of the Lagrangian, in the units of the objective
  double feasibility;      // gaps and the end
  double complementarity;  // the largest u^T z
  double gap;              // sum of all u^T z: how far the objective may be from its optimum
};

// First-order conditions, and what lengths do, with the costates of the adjoint recursion, so that all that is missing
// is in the forces.
Conditions conditions(const Problem& problem, Iterate& it);

// Sum of u^T z, and how many cones there are.
double complementarity(const Iterate& it, int& cones);

}  // namespace stridelab
