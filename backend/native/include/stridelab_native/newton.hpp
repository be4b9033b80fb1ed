// One Newton step: forces condensed to the wrench, stages eliminated backwards, the step rolled out forwards.
//
// With D = h Q + W^-2 for every point and S = sum G D^-1 G^T = L L^T, the forces of an interval cost |omega + tau|^2 /
// 2 for a change dw = L omega of the wrench, tau = L^-1 sum G D^-1 g. So the control of the Riccati recursion is omega,
//
//   I + L^T (H_ww + B^T P B) L  >= I
//
// of six entries for any number of points; without contacts L is zero, without a special case.
#pragma once
#include "stridelab_native/ending.hpp"

namespace stridelab {

// Scaling of all cones, and D^-1.
void scale_cones(Iterate& it);

// Shares of the indefinite parts of the exact Hessian: of the densities' covariances and other terms that are not
// squares, of those with free lengths, and of the momentum's second derivative between c and F.
struct Theta {
  double densities = 0.0;
  double lengths = 0.0;
  double twist = 0.0;
};

// Backward recursion; false if the reduced Hessian is not positive definite.
bool factor(const Problem& problem, Iterate& it, const Penalty& penalty, Theta theta);

// tau, kappa and the step for the current targets.
void direction(const Problem& problem, Iterate& it, const Penalty& penalty);

}  // namespace stridelab
