// The new multipliers of the cones, by the costates that a step leads to: their stationarity then holds to rounding.
//
// The factor L of the compliance S gives the same slopes in the wrench, but for directions in which no cone yields any
// more: where a sole stands on one edge, S has no pivot left for what turns it about this edge, and the forces on the
// other edge, which are zero, have multipliers all the same.
#pragma once
#include "stridelab_native/ending.hpp"
#include "stridelab_native/iterate.hpp"

namespace stridelab {

// dz of all points, after dx, dw and du.
void follow_costates(const Problem& problem, Iterate& it, const Ending& end, const Penalty& penalty);

}  // namespace stridelab
