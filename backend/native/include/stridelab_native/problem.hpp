// The problem (4.20) as flat data; positions relative to the CoM at the start, forces in m |g|.
#pragma once
#include <array>
#include <limits>
#include <vector>

#include "stridelab_native/vec.hpp"

namespace stridelab {

inline constexpr double gravity = 9.81;
inline constexpr int nx = 9;  // x = (c, c', K)
inline constexpr int nw = 6;  // (F, T)
inline constexpr double unbounded = std::numeric_limits<double>::infinity();

// p(y) = sum_j w_j N(y; mu_j, S_j): eight components at a time, log constants of absent ones at -1e300.
struct Density {
  struct Eight {
    v8 constant;
    v8 mean[3];
    v8 W[6];          // S^-1 = W^T W, W lower triangular by rows: 00, 10, 11, 20, 21, 22
    v8 precision[6];  // S^-1: 00, 01, 02, 11, 12, 22
  };
  std::vector<Eight> eights;
};

// A density in the cost of a phase: y = R^T (c - place), R by rows.
struct Visit {
  int density = 0;
  double place[3] = {};
  double R[9] = {};
  int moved = -1;  // of the places; -1: none
};

// Up to four points of a contact that share a frame: f = S u, S = R diag(mu, mu, 1) by rows, u = (f_t / mu, f_n).
struct Block {
  v4 real;  // 1 for a point, 0 for padding
  v4 p[3];
  double normal_max;  // on u_n; infinite: none
  double effort[2];   // h/2 (effort[0] |u_t|^2 + effort[1] u_n^2) is the cost of a point
  double S[9];
  int points;
  int moved;         // of the places; -1: none
  bool comes, goes;  // splines only: zero force at the first, at the last control point of the phase
};

// The wrench as control, u_c: (F, T) = G u, u = (tau, eta) with eta = 1 for the weight; absent entries have zero
// columns.
struct WrenchCone {
  double G[nw][nw];
  double effort;  // h/2 effort |u|^2 is its cost
};

// For splines, an interval here is one of the two free control points of an interval between nodes, and h is half of
// it.
struct Phase {
  int intervals;
  double h;
  int first_block, blocks;
  int first_visit, visits;
  int cone;  // of the wrench cones; -1: none
};

// At rest: x_N = goal and F = (0, 0, 1) in the last interval. Capturable: height and vertical velocity of the goal, no
// angular momentum, and the capture point inside every half-plane. Upright: the same without the momentum about the
// vertical, which is not linear. Moving: x_N = goal, which may have a velocity and a momentum.
enum class End { rest, capturable, upright, moving };

// normal (c_x, c_y, c'_x, c'_y) <= offset.
struct Plane {
  double normal[4];
  double offset;
};

// Limits of free interval lengths: each phase has one length, between `shortest` and `longest` times the given one. The
// total duration is `total`, or costs `price` per second if `total` is infinite.
struct LengthLimits {
  bool lengths = false;
  double shortest = 1.0, longest = 1.0;
  double total = unbounded;
  double price = 0.0;
};

// Forces between nodes: constant, or cubic splines.
enum class Shape { constant, cubic };
// A movable contact, from its first to its last phase: displacements d along two axes, low <= d <= high.
struct Place {
  int first_phase, last_phase;
  double axes[2][3];
  double low[2], high[2];
};

struct Problem {
  double w_acceleration = 10.0;  // w_c
  double w_momentum = 10.0;      // w_L (m |g|)^2
  double w_likelihood = 1.0;
  std::array<double, nx> start{}, goal{};
  End end = End::rest;
  std::vector<Density> densities;
  std::vector<Visit> visits;
  std::vector<Block> blocks;
  std::vector<WrenchCone> cones;
  std::vector<Phase> phases;
  std::vector<Plane> planes;
  std::vector<Place> places;      // in the order of their last phases
  std::vector<double> limbs;      // rate of the limbs' momentum, three per interval, for splines per Gauss point
  std::vector<double> reference;  // accelerations that c'' is compared with, rows as of limbs, m/s^2
  // Lowest and highest c_z at the first node of every interval, except the start; infinite: none; no rows: nowhere.
  std::vector<std::array<double, 2>> heights;
  LengthLimits length_limits;
  Shape shape = Shape::constant;
};

}  // namespace stridelab
