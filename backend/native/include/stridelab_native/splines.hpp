// Forces that are cubic splines instead of constants. In an interval of length h, with s = t / h and Bernstein's B_i,
//
//   w(t) = sum B_i(s) w_i,   w_0 = (1 - a) w_2- + a w_1,   w_3 = b w_2 + (1 - b) w_1+
//
// so that the wrench w and its rate are continuous; w_1 and w_2 are free, and in the cones (`stages` holds one of
// each). By the four that count in an interval, v = (w_2-, w_1, w_2, w_1+), it is sum phi_j(s) v_j.
//
// The recursion goes from node to node with the state (x, w_2-, w_1), of 21 entries, and the control (w_2, w_1+), of
// twelve; forces are condensed to their wrenches as `newton` does.
#pragma once
#include "stridelab_native/newton.hpp"

namespace stridelab {

inline constexpr int n_gauss = 4;

// phi_j at Gauss' points and its integrals from 0: twice up to there; once, twice and thrice up to 1.
struct Basis {
  double at[n_gauss][4], twice[n_gauss][4];
  double ends[3][4];
};

double gauss_point(int g);
double gauss_weight(int g);
Basis basis(const Spline& spline);

// Wrench and CoM at a point of Gauss of an interval that begins at x.
struct Instant {
  double w[nw], c[3];
};

Instant instant(const Basis& of, int g, double h, const double* x, const double* const (&v)[4]);

// Adds B_j v to x+; A^T l to to_x is that of constants.
void push(const Basis& of, int j, double h, const double* v, double* next);
// Adds B_j^T l.
void pull(const Basis& of, int j, double h, const double* l, double* y);

// The stage of v_j in interval k; null where there is none.
inline Stage* stage_of(Iterate& it, std::size_t k, int j) {
  if ((j == 0 && k == 0) || (j == 3 && k + 1 == it.splines.size())) return nullptr;
  return &it.stages[2 * k + static_cast<std::size_t>(j) - 1];
}

// Of w at the nodes: lengths of intervals decide how they join.
void join(Iterate& it);

// The squares of (4.20a) by Gauss' rule: adds their gradient to q and r, and fills gap.
double curved_squares(const Problem& problem, Iterate& it);

// Slopes y of all stages from the costate of the end, bounds on heights with them.
void pull_splines(Iterate& it, double costate[nx]);

// As `factor` and `direction`.
bool factor_splines(const Problem& problem, Iterate& it, const Penalty& penalty, double theta);
void direct_splines(const Problem& problem, Iterate& it, const Penalty& penalty);

}  // namespace stridelab
