// Cubic spline forces instead of constants. In an interval of length h, with s = t / h and Bernstein polynomials B_i,
//
//   w(t) = sum B_i(s) w_i,   w_0 = (1 - a) w_2- + a w_1,   w_3 = b w_2 + (1 - b) w_1+
//
// so that the wrench w and its rate are continuous; w_1 and w_2 are free and in the cones (one stage each). In terms of
// the four that act in an interval, v = (w_2-, w_1, w_2, w_1+), it is sum phi_j(s) v_j.
//
// The recursion goes from node to node with the state (x, w_2-, w_1), of 21 entries, and the control (w_2, w_1+), of
// twelve; forces are condensed to their wrenches as `newton` does.
#pragma once
#include "stridelab_native/newton.hpp"

namespace stridelab {

inline constexpr int n_gauss = 4;

// phi_j at the Gauss points and its integrals from 0: second up to there; first, second and third up to 1.
struct Basis {
  double at[n_gauss][4], twice[n_gauss][4];
  double ends[3][4];
};

double gauss_point(int g);
double gauss_weight(int g);
Basis basis(const Spline& spline);

// Wrench and CoM at a Gauss point of an interval that begins at x.
struct Instant {
  double w[nw], c[3];
};

Instant instant(const Basis& of, int g, double h, const double* x, const double* const (&v)[4]);

// Add B_j v to x+; A is that of constant forces.
void push(const Basis& of, int j, double h, const double* v, double* next);
// Adds B_j^T l.
void pull(const Basis& of, int j, double h, const double* l, double* y);

// The stage of v_j in interval k; null if it does not exist.
inline Stage* stage_of(Iterate& it, std::size_t k, int j) {
  if ((j == 0 && k == 0) || (j == 3 && k + 1 == it.splines.size())) return nullptr;
  return &it.stages[2 * k + static_cast<std::size_t>(j) - 1];
}

// Weights of w at the nodes, from the lengths of adjacent intervals.
void join(Iterate& it);

// The squares of (4.20a) by the Gauss rule: adds their gradient to q and r, and computes gap.
double curved_squares(const Problem& problem, Iterate& it);

// Slopes y of all stages from the costate of the end, including height bounds.
void pull_splines(Iterate& it, double costate[nx]);

// As `factor` and `direction`.
bool factor_splines(const Problem& problem, Iterate& it, const Penalty& penalty, double theta);
void direct_splines(const Problem& problem, Iterate& it, const Penalty& penalty);

}  // namespace stridelab
