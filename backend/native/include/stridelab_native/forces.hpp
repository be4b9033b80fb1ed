// Point forces of an interval as control, condensed to their wrench, for `newton`.
#pragma once
#include "stridelab_native/iterate.hpp"

namespace stridelab {

// Scaling and D^-1 of the points of an interval.
void scale_forces(Iterate& it, const Stage& s);

// L L^T = S.
void root_of_forces(const Iterate& it, Stage& s);

// tau = L^-1 sum G D^-1 g with g = h Q u - target; returns sum u^T Q D^-1 g. The second one uses g = Q u.
double condensed_gradient(const Iterate& it, const Stage& s, double tau[nw]);
double condensed_effort_gradient(const Iterate& it, const Stage& s, double tau[nw]);

// du = D^-1 (G^T L^-T omega - g - dh Q u), and dz.
void follow(Iterate& it, const Stage& s, double omega[nw], double dh);

// dz = S^T y + h Q (u + du) - z for the slope y in the wrench after the step, with the bounds at its end.
void follow_slope(Iterate& it, const Stage& s, const double y[nw]);

// For a movable contact: F, the sum of its forces; tau of its two displacements, with g the mixed derivative `pull`
// with the forces, and curve -= g_a^T D^-1 g_b from index `at` on; drag = g_a^T D^-1 g.
void force_of(const Iterate& it, const Stage& s, int place, double F[3]);
void condensed_shift_gradient(const Iterate& it, const Stage& s, const ShiftUse& use, Share* shares,
                              double curve[shares_max][shares_max], std::size_t at);
void drag_of_shift(const Iterate& it, const Stage& s, const ShiftUse& use, double drag[2]);

}  // namespace stridelab
