// Whether there are forces at all that lead to the end: the constraints are linear and conic, so that it can be
// decided.
#pragma once
#include "stridelab_native/solver.hpp"

namespace stridelab {

// The least effort that reaches the end. `solved`: `it` stands there, a start for the whole problem. `infeasible`: the
// multipliers l of the end prove that none does,
//
//   M^T l in K* at every point,   l^T (what the end misses by without forces) > 0,
//
// with M what the forces do to the end, so that l^T (miss) > 0 whatever the forces; `stage` is where l pulls hardest.
// Bounds take part with their own multipliers.
Report feasibility(const Problem& problem, Iterate& it, const Settings& settings);

}  // namespace stridelab
