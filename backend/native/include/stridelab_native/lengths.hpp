// Free lengths of intervals. With h of a phase and the time t at its end as two more states that stay as they are,
//
//   V = 1/2 x^T P x + x^T E (dh, dt) + 1/2 (dh, dt) C (dh, dt) + p^T x + c^T (dh, dt),    x+ = A x + B w + f dh
//
// E and C go back with P, and c with p, from interval to interval; where a phase begins t is t- + n h, and h is
// eliminated.
#pragma once
#include "stridelab_native/ending.hpp"

namespace stridelab {

struct Columns {
  double E[nx][2];
  double C[2][2];
};

// Lengths as variables, where they stand.
void free_lengths(const Problem& problem, Iterate& it);

// f, and the derivatives of the cost and of costate^T x+ in h, after `evaluate`; the slope of both together.
double stretch(const Problem& problem, const Stage& s, Stretch& of);

// What all lengths together miss by; 0 where that is free.
double total_missed(const Problem& problem, const Iterate& it);

// Columns of the factor: at the end of all; where a phase ends; before, with P of its end, and after an interval is
// eliminated, with the share theta of what is not squared, `drag` is g^T D^-1 g of g = e Q u; where a phase begins,
// false where h cannot be eliminated.
Columns columns(const Problem& problem, const Penalty& penalty);
void enter(const Length& length, Columns& to);
void approach(const Stage& s, Stretch& of, const double P[nx][nx], Columns& to);
void pass(const Stage& s, Stretch& of, double theta, double drag, Columns& to);
bool leave(Length& length, Columns& to, double P[nx][nx]);

// The same of c: an interval with p of its end and with `drag` u^T Q D^-1 g.
void approach(const Stretch& of, const double p[nx], double c[2]);
void pass(const Stage& s, const Stretch& of, double drag, double c[2]);
void leave(Length& length, double p[nx], double c[2]);

// dh from the step of x where the phase begins and of t before it; returns what the phase adds to that of t.
double step_of(Length& length, const double dx[nx], double dt);

// The length of a stage's phase; null where lengths are given.
inline Length* length_of(const Problem& problem, Iterate& it, const Stage& s) {
  return it.lengths.empty() ? nullptr : &it.lengths[static_cast<std::size_t>(s.phase - problem.phases.data())];
}

}  // namespace stridelab
