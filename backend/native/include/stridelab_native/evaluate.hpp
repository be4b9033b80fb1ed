// The cost of (4.20a) with regularisers, its derivatives and the gaps of the dynamics.
#pragma once
#include "stridelab_native/iterate.hpp"

namespace stridelab {

// Computes w, m, gap, q, r and log_density of every stage; returns the cost.
double evaluate(const Problem& problem, Iterate& it);

struct Conditions {
  double stationarity;     // of the Lagrangian, in the units of the objective
  double feasibility;      // gaps and the end
  double complementarity;  // the largest u^T z
  double gap;              // sum of all u^T z: bound of the objective's distance from its optimum
};

// First-order conditions, including lengths, with the costates of the adjoint recursion, so that only the forces have
// dual residuals.
Conditions conditions(const Problem& problem, Iterate& it);

// Sum of u^T z; sets the number of cones.
double complementarity(const Iterate& it, int& cones);

}  // namespace stridelab
