// State of the iteration: variables, derivatives and factors per stage.
#pragma once
#include <vector>

#include "stridelab_native/cone.hpp"
#include "stridelab_native/mixture.hpp"
#include "stridelab_native/problem.hpp"

namespace stridelab {

// A bound a <= b with its slack and multiplier: r = a + s - b.
template <typename T>
struct Slack {
  T s, zeta, r, target, ds, dzeta;

  T weight() const { return zeta / s; }
  T pull() const { return (target + zeta * r) / s; }  // the new zeta for constant a
  void follow(T da) {
    ds = -r - da;
    dzeta = (target - zeta * ds) / s - zeta;
  }
};

// Conic variables of one interval, with their step.
template <typename T, int n>
struct Inside {
  Cone<T, n> at;
  Scaling<T, n> scaling;
  T target[n];  // W^-1 (lambda \ (sigma mu e - correction)): the part of the new z that does not depend on du
  T du[n];
  T dz[n];
};

// D^-1/2 with D = W^-2 + e, whose eigenvectors are those of W: (d, 1) and (d, -1) over root two, and all orthogonal.
struct Spectrum {
  double d[nw - 1];
  double along, against, rest;
};

// A block of contact points.
struct ContactBlock : Inside<v4, 3> {
  v4 D_inverse[6];
  const Block* block;
  int load;  // of it.loads; -1: none

  v4 real() const { return block->real; }
  double effort(int i) const { return block->effort[i == 2]; }
};

// A wrench in its own cone.
struct WrenchControl : Inside<double, nw> {
  Spectrum D_root;
  const WrenchCone* cone;

  double real() const { return 1.0; }
  double effort(int) const { return cone->effort; }
};

// Second derivatives in one variable, such as the length h of an interval: with (c, c'), with w, and with itself.
struct SecondDerivatives {
  double q[6], r[nw], curve;
};

// An interval whose length h is a variable.
struct FreeInterval {
  double f[nx];                     // dx+ / dh
  double slope;                     // of the cost
  SecondDerivatives squared, more;  // of the Lagrangian: Gauss-Newton part of the squares, and the rest
  double tau[nw];                   // of e Q u
  double Y[nw][2];                  // of h and of the time until the end of the phase
  double pulled_by_gap[2];
};

// The length of the intervals of a phase.
struct Length {
  std::size_t first, intervals;
  double given;
  double h, dh;
  double slope;     // of the cost, without the intervals' own
  double mixed[3];  // and with c at the node that ends the phase
  double E[nx], cross, pivot, pull;
  Slack<double> low, high;  // of h / given
};

inline constexpr int shares_max = 8;

// Derivatives of an interval with respect to one of the shared variables.
struct Share {
  std::size_t column;
  double f[nx];        // dx+ / dtheta
  double slope;        // of the cost
  double q[6], r[nw];  // second derivatives of the Lagrangian: with (c, c') and with w
  double tau[nw];      // L^-1 sum G D^-1 g, with g the mixed derivative with the forces
};

// Variables shared by many intervals: columns of the factor.
struct Border {
  std::size_t size = 0, row = 0;  // row: size, padded
  std::vector<double> E, C, Y;    // (nx, row); (row, row), upper triangle; (intervals, nw, row)
  std::vector<double> by_gap, c, step, root;
};

// A movable contact, displaced by d along its axes within its window.
struct Shift {
  const Place* place;
  double d[2], step[2];
  Slack<double> low[2], high[2];  // in units of the window
};

// A movable contact in an interval; its densities at the first node of the interval and at the last node of its phase.
struct ShiftUse {
  std::size_t shift;
  DensityDerivatives own, before;
  double pull[2][3];  // mixed derivative of its forces (world axes) with each displacement
};

// Interval k, and the node that begins it.
struct Stage {
  // Given.
  const Phase* phase;
  double h;
  int first_contact_block, contact_blocks;
  int hold;  // of it.holds; -1: none
  std::size_t first_shift_use, shift_uses;
  std::size_t columns;  // first column of the border that it or a later stage depends on
  double limbs[3];
  double reference[3];
  // Variables and derived quantities.
  double x[nx];
  double w[nw];
  double m[3];  // c + h/2 c' + h^2/6 g
  double l[3];  // T - m x F, the rate of the momentum about the CoM, minus the limbs' rate
  double gap[nx];
  double y[nw];              // slope of the Lagrangian in w
  double costate[nx];        // of its last node
  double effort;             // per unit of h
  double own[4], before[4];  // the log-densities of the phase and of the one before: cost and slope in c per unit of h
  double q[nx];              // gradient of the cost
  double r[nw];
  DensityDerivatives log_density;
  // Factors.
  double L[nw][8], L_inverse[nw];
  double R[nw][8], R_inverse[nw];
  double Y[nw][nx];
  double P_gap[nx];
  double tau[nw];
  double kappa[nw];
  // Step.
  double dx[nx];
  double dw[nw];
  Slack<double> low, high;  // of c_z between its bounds
  std::array<double, 2> height;
  bool bounded;
};

// A spline interval between two nodes, which has two stages: data of `splines`.
struct Spline {
  double own[2];        // weights of its own control points in its two ends
  double rows[12][40];  // R and Y
  double inverse[12];   // of R's diagonal
  double P_gap[21];
  double kappa[12];
};

struct Iterate {
  std::vector<Stage> stages;  // one more than intervals: the last is the end node
  std::vector<ContactBlock> contact_blocks;
  std::vector<WrenchControl> wrench_controls;
  std::vector<Slack<v4>> loads;  // of u_n below its bound
  std::vector<Slack<double>> planes;
  std::vector<Length> lengths;               // empty: all as given
  std::vector<FreeInterval> free_intervals;  // as many as intervals where lengths are free
  std::vector<Spline> splines;               // empty where forces are constant
  std::vector<Shift> shifts;                 // empty: all as given
  std::vector<ShiftUse> shift_uses;
  std::vector<Share> shares;  // two per shift use
  Border border;
  double pull_share = 1.0;         // share of the second derivatives between displacements and forces
  const Problem* given = nullptr;  // with movable contacts: the given problem, and its copy with the current placements
  Problem* moved = nullptr;
  double theta = 1.0;         // shares in the factor: of the covariances,
  double twist = 0.0;         // of the momentum's second derivative
  double effort_share = 1.0;  // e: the effort's mixed derivative with h is taken as e Q u
  double nu_total = 0.0;
  double nu[nx] = {};      // multipliers of the end
  double nu_rest[3] = {};  // of F = (0, 0, 1) in the last interval
};

// Apply f to all conic variables.
template <typename It, typename F>
void each_cone(It& it, F f) {
  for (auto& t : it.contact_blocks) f(t);
  for (auto& h : it.wrench_controls) f(h);
}

// Apply f(slack, mask) to all slacks.
template <typename It, typename F>
void each_slack(It& it, F f) {
  for (auto& t : it.contact_blocks) {
    if (t.load >= 0) f(it.loads[static_cast<std::size_t>(t.load)], t.block->real);
  }
  for (auto& s : it.stages) {
    if (!s.bounded) continue;
    f(s.low, 1.0);
    f(s.high, 1.0);
  }
  for (auto& p : it.planes) f(p, 1.0);
  for (auto& l : it.lengths) {
    f(l.low, 1.0);
    f(l.high, 1.0);
  }
  for (auto& s : it.shifts) {
    for (int i = 0; i < 2; ++i) {
      f(s.low[i], 1.0);
      f(s.high[i], 1.0);
    }
  }
}

}  // namespace stridelab
