// The wrench of an interval as control in its own cone, for `newton`.
#pragma once
#include "stridelab_native/iterate.hpp"

namespace stridelab {

// w += G u, and G^T y.
void add_wrench(const WrenchControl& hold, const double (&u)[nw], double* w);
void pull_wrench(const WrenchControl& hold, const double* y, double (&out)[nw]);

// Scaling and D^-1/2.
void scale(WrenchControl& hold, double h);

// L = G D^-1/2: with du = D^-1/2 omega no inverse is needed, even for a nearly singular S = L L^T.
void root_of(const WrenchControl& hold, double L[nw][8]);

// tau = D^-1/2 g with g = h effort u - target.
void condensed_gradient(const WrenchControl& hold, double h, double tau[nw]);

// du = D^-1/2 omega, and dz.
void follow(WrenchControl& hold, const double (&omega)[nw]);

}  // namespace stridelab
