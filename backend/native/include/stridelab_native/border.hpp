// Variables theta shared by many intervals (placements of contacts), with x+ = A x + B w + F dtheta,
//
//   V = 1/2 x^T P x + x^T E d + 1/2 d^T C d + p^T x + c^T d,    d = dtheta
//
// E and C are propagated backwards with P, and c with p, to the first node, where min 1/2 d^T C d + c^T d remains.
// Variables are ordered by the last intervals that depend on them, so that those of an interval are the last ones.
#pragma once
#include "stridelab_native/iterate.hpp"

namespace stridelab {

// Allocate `size` variables; those of every interval are set by its stage.
void make_border(Iterate& it, std::size_t size);

// E and C: initialise at the end of the motion; update before an interval is eliminated, with P of its end; and after,
// with tau of its shares and their second derivatives minus g_a^T D^-1 g_b of their slopes in the forces.
void begin_columns(Border& border);
void approach(Iterate& it, const Stage& s, const double P[nx][nx]);
void pass(Iterate& it, std::size_t k, const double curve[shares_max][shares_max]);

// c, likewise: with p of the end of the interval, P_gap included; with `drag` = g_a^T D^-1 g.
void begin_slopes(Border& border);
void approach(Iterate& it, const Stage& s, const double p[nx]);
void pass(Iterate& it, std::size_t k, const double drag[shares_max]);

// out += Y d of an interval.
void add_columns(const Iterate& it, std::size_t k, double out[nw]);

inline Share* shares_of(Iterate& it, const Stage& s) { return it.shares.data() + 2 * s.first_shift_use; }
inline const Share* shares_of(const Iterate& it, const Stage& s) { return it.shares.data() + 2 * s.first_shift_use; }

}  // namespace stridelab
