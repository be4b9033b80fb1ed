// Feasibility: whether forces exist that reach the end. The constraints are linear and conic, so it can be decided.
#pragma once
#include "stridelab_native/solver.hpp"

namespace stridelab {

// Minimise the effort that reaches the end. `solved`: `it` is a start for the whole problem. `infeasible`: the
// multipliers l of the end are a certificate,
//
//   M^T l in K* at every point,   l^T (residual of the end without forces) > 0,
//
// with M the effect of the forces on the end, so that l^T (residual) > 0 for all forces; `stage` is where l is most
// violated. Bounds and the planes of a capturable end take part with their own multipliers. The end's momentum about
// the vertical is bilinear and omitted; a problem that is infeasible without it is infeasible.
Report feasibility(const Problem& problem, Iterate& it, const Settings& settings);

}  // namespace stridelab
