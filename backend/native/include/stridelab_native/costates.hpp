// New multipliers of the cones from the costates after a step: their stationarity then holds up to rounding.
//
// The factor L of the compliance S gives the same slopes in the wrench, except in directions without compliance: for a
// sole on one edge, S is singular for rotations about this edge, but the zero forces on the other edge still have
// multipliers.
#pragma once
#include "stridelab_native/ending.hpp"
#include "stridelab_native/iterate.hpp"

namespace stridelab {

// dz of all points, after dx, dw and du.
void follow_costates(const Problem& problem, Iterate& it, const Ending& end, const Penalty& penalty);

}  // namespace stridelab
