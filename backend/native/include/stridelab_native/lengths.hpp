// Free lengths of intervals. With h of a phase and the time t at its end as two additional constant states,
//
//   V = 1/2 x^T P x + x^T E (dh, dt) + 1/2 (dh, dt) C (dh, dt) + p^T x + c^T (dh, dt),    x+ = A x + B w + f dh
//
// E and C are propagated backwards with P, and c with p; at the start of a phase t is t- + n h, and h is eliminated.
#pragma once
#include "stridelab_native/ending.hpp"

namespace stridelab {

struct Columns {
  double E[nx][2];
  double C[2][2];
};

// Make the lengths variables at their current values.
void free_lengths(const Problem& problem, Iterate& it);

// f, and the derivatives of the cost and of costate^T x+ in h, after `evaluate`; the slope of both together.
double differentiate_length(const Problem& problem, const Stage& s, FreeInterval& of);

// Error of the total length; 0 if the total is free.
double total_length_error(const Problem& problem, const Iterate& it);

// Columns of the factor: `columns` at the end of the motion; `enter` at the end of a phase; `approach` before, with P
// of its end, and `pass` after an interval is eliminated, with the share theta of the terms that are not squares and
// `drag` = g^T D^-1 g of g = e Q u; `leave` at the start of a phase, false if h cannot be eliminated.
Columns columns(const Problem& problem, const Penalty& penalty);
void enter(const Length& length, Columns& to);
void approach(const Stage& s, FreeInterval& of, const double P[nx][nx], Columns& to);
void pass(const Stage& s, FreeInterval& of, double theta, double drag, Columns& to);
bool leave(Length& length, Columns& to, double P[nx][nx]);

// The same for c: with p of the interval's end and with `drag` = u^T Q D^-1 g.
void approach(const FreeInterval& of, const double p[nx], double c[2]);
void pass(const Stage& s, const FreeInterval& of, double drag, double c[2]);
void leave(Length& length, double p[nx], double c[2]);

// dh from the steps of x at the start of the phase and of t before it; returns the phase's contribution to that of t.
double step_of(Length& length, const double dx[nx], double dt);

// The length of a stage's phase; null for fixed lengths.
inline Length* length_of(const Problem& problem, Iterate& it, const Stage& s) {
  return it.lengths.empty() ? nullptr : &it.lengths[static_cast<std::size_t>(s.phase - problem.phases.data())];
}

}  // namespace stridelab
