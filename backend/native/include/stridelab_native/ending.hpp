// End conditions: equations with multipliers nu and a proximal weight, and the half-planes of the capture point.
#pragma once
#include "stridelab_native/iterate.hpp"

namespace stridelab {

struct Penalty {
  double end;  // proximal weights of the equations at the end; their multipliers are it.nu, it.nu_rest
  double rest;
};

// Equations at the end: residuals and their Jacobian in x_N.
struct Ending {
  int rows;
  double miss[nx];
  double J[nx][nx];
  double rest[3];  // F - (0, 0, 1) in the last interval; zero if not required
  bool rests;
};

Ending ending(const Problem& problem, const Iterate& it);

// P_N, with `exact_curvature` of c x c', and p_N for the current targets.
void end_hessian(const Problem& problem, const Iterate& it, const Ending& end, const Penalty& penalty,
                 bool exact_curvature, double P[nx][nx]);
void end_gradient(const Problem& problem, const Iterate& it, const Ending& end, const Penalty& penalty, double p[nx]);

// J^T nu + planes^T zeta: the costate of the end.
void end_costate(const Problem& problem, const Iterate& it, const Ending& end, double costate[nx]);

// Steps of the planes' slacks.
void end_steps(const Problem& problem, Iterate& it);

// nu += share * penalty * (residuals of the end after the step).
void move_multipliers(const Problem& problem, Iterate& it, const Penalty& penalty, double share);

// a of a plane at x.
inline double capture(const Plane& plane, const double* x) {
  return plane.normal[0] * x[0] + plane.normal[1] * x[1] + plane.normal[2] * x[3] + plane.normal[3] * x[4];
}

}  // namespace stridelab
