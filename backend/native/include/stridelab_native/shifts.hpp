// Contacts that are movable on their surfaces. A displacement d along the axis a adds a torque of the contact's forces
// F_s, T = T(u) + d a x F_s, and moves the contact's densities:
//
//   dx+ = h a x F_s in K,   second derivatives: wl t, t = a x F_s, with the torque,  S^T (y_T x a) with the forces,
//
// y_T the slope of the Lagrangian in the torque.
#pragma once
#include "stridelab_native/iterate.hpp"

namespace stridelab {

// Make the contacts variables at their current placements; `moved` is a copy of the problem with current placements.
void free_shifts(const Problem& given, Problem& moved, Iterate& it);

// Return the iterate to the given problem.
void release_shifts(const Problem& given, Iterate& it);

// Update contact points and densities to the displacements.
void place_contacts(Iterate& it);

// The derivatives of the densities of a moved contact: at the node of a stage, or at the end of its phase.
DensityDerivatives* density_derivatives_of(Iterate& it, const Stage& s, int place, bool ends);

// Residuals of the windows.
void window_residuals(Iterate& it);

// Derivatives of the cost and of costate^T x+ in the displacements; the largest slope of the Lagrangian.
double differentiate_shifts(const Problem& problem, Iterate& it);

double slope_of_shifts(const Iterate& it);

// Updates of the factor: at the end of a phase, with the share theta of the densities' covariances; after an interval.
void leave_phase(Iterate& it, const Stage& s, double theta);
void pass_shift_uses(const Problem& problem, Iterate& it, std::size_t k, double theta);

// Factorise the remaining problem in all displacements; false if it is not convex.
bool factor_shifts(Iterate& it);

// Updates of the direction: after an interval; the steps of all displacements.
void pass_slopes(Iterate& it, std::size_t k);
void step_shifts(Iterate& it);

}  // namespace stridelab
