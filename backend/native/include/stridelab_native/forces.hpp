// The forces of an interval as control, condensed to their wrench: what `newton` wants of them.
#pragma once
#include "stridelab_native/iterate.hpp"

namespace stridelab {

// Scaling and D^-1 of the points of an interval.
void scale_forces(Iterate& it, const Stage& s);

// L L^T = S.
void root_of_forces(const Iterate& it, Stage& s);

// tau = L^-1 sum G D^-1 g with g = h Q u - target; returns sum u^T Q D^-1 g. And with g = Q u.
double pulled(const Iterate& it, const Stage& s, double tau[nw]);
double pulled_by_effort(const Iterate& it, const Stage& s, double tau[nw]);

// du = D^-1 (G^T L^-T omega - g - dh Q u), and dz.
void follow(Iterate& it, const Stage& s, double omega[nw], double dh);

}  // namespace stridelab
