// The wrench of an interval as control in a cone of its own: what `newton` wants of it.
#pragma once
#include "stridelab_native/iterate.hpp"

namespace stridelab {

// w += G u, and G^T y.
void add_wrench(const Hold& hold, const double (&u)[nw], double* w);
void pull_wrench(const Hold& hold, const double* y, double (&out)[nw]);

// Scaling and D^-1/2.
void scale(Hold& hold, double h);

// L = G D^-1/2: with du = D^-1/2 omega nothing is inverted, however thin S = L L^T may be.
void root_of(const Hold& hold, double L[nw][8]);

// tau = D^-1/2 g with g = h effort u - target.
void pulled(const Hold& hold, double h, double tau[nw]);

// du = D^-1/2 omega, and dz.
void follow(Hold& hold, const double (&omega)[nw]);

}  // namespace stridelab
