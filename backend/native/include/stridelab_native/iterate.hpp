// Where an iteration stands: variables, derivatives and factors, stage by stage.
#pragma once
#include <vector>

#include "stridelab_native/cone.hpp"
#include "stridelab_native/mixture.hpp"
#include "stridelab_native/problem.hpp"

namespace stridelab {

// A block of points in one interval.
struct Touch {
  Cones at;
  Scaling scaling;
  v4 D_inverse[6];
  v4 target[3];  // W^-1 (lambda \ (sigma mu e - correction)): the part of the new z that does not depend on du
  v4 du[3];
  v4 dz[3];
  const Block* block;
};

// Interval k, and the node that begins it.
struct Stage {
  // Given.
  const Phase* phase;
  double h;
  int first_touch, touches;
  // Variables and what follows from them.
  double x[nx];
  double w[nw];
  double m[3];  // c + h/2 c' + h^2/6 g
  double gap[nx];
  double q[nx];  // gradient of the cost
  double r[nw];
  Bend bend;
  // Factors.
  double L[nw][8], L_inverse[nw];
  double R[nw][8], R_inverse[nw];
  double Y[nw][nx];
  double P_gap[nx];
  double tau[nw];
  double kappa[nw];
  // Step.
  double dx[nx];
  double dw[nw];
};

struct Iterate {
  std::vector<Stage> stages;  // one more than intervals: the last is the end node
  std::vector<Touch> touches;
  double nu[nx] = {};       // multipliers of the end
  double nu_rest[3] = {};   // of F = (0, 0, 1) in the last interval
};

}  // namespace stridelab
