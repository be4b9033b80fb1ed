// Contacts that may be moved on their surfaces. A displacement d along the axis a turns the forces F_s of its contact
// into a torque, T = T(u) + d a x F_s, and takes the contact's densities with it:
//
//   dx+ = h a x F_s in K,   second derivatives: wl t, t = a x F_s, with the torque,  S^T (y_T x a) with the forces,
//
// y_T what a torque is worth.
#pragma once
#include "stridelab_native/iterate.hpp"

namespace stridelab {

// Contacts as variables, where they are; `moved` is a copy of the problem that follows them from now on.
void free_shifts(const Problem& given, Problem& moved, Iterate& it);

// The iterate back on the problem as it was given.
void let_go(const Problem& given, Iterate& it);

// Points and densities where the displacements say.
void place_contacts(Iterate& it);

// The derivatives of the densities of a moved contact: at the node of a stage, or at the end of its phase.
Bend* bend_of(Iterate& it, const Stage& s, int place, bool ends);

// What windows miss by.
void miss_windows(Iterate& it);

// Derivatives of the cost and of costate^T x+ in the displacements; the largest slope of the Lagrangian.
double meet(const Problem& problem, Iterate& it);

double slope_of_shifts(const Iterate& it);

// Of the factor: where a phase ends, with the share theta of the densities' covariances; after an interval.
void leave_phase(Iterate& it, const Stage& s, double theta);
void pass_meetings(const Problem& problem, Iterate& it, std::size_t k, double theta);

// What is left of all displacements; false where it is not convex.
bool factor_shifts(Iterate& it);

// Of the direction: after an interval; the steps of all displacements.
void pass_slopes(Iterate& it, std::size_t k);
void step_shifts(Iterate& it);

}  // namespace stridelab
