// Where an iteration stands: variables, derivatives and factors, stage by stage.
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
  T pull() const { return (target + zeta * r) / s; }  // the new zeta for a that stays
  void follow(T da) {
    ds = -r - da;
    dzeta = (target - zeta * ds) / s - zeta;
  }
};

// What lies in cones in one interval, with its step.
template <typename T, int n>
struct Inside {
  Cone<T, n> at;
  Scaling<T, n> scaling;
  T target[n];  // W^-1 (lambda \ (sigma mu e - correction)): the part of the new z that does not depend on du
  T du[n];
  T dz[n];
};

// D^-1/2 with D = W^-2 + e, whose eigenvectors are those of W: (d, 1) and (d, -1) over root two, and all across them.
struct Spectrum {
  double d[nw - 1];
  double along, against, rest;
};

// A block of points.
struct Touch : Inside<v4, 3> {
  v4 D_inverse[6];
  const Block* block;
  int load;  // of it.loads; -1: none

  v4 real() const { return block->real; }
  double effort(int i) const { return block->effort[i == 2]; }
};

// A wrench in its own cone.
struct Hold : Inside<double, nw> {
  Spectrum D_root;
  const WrenchCone* cone;

  double real() const { return 1.0; }
  double effort(int) const { return cone->effort; }
};

// Second derivatives in the length h of an interval: with (c, c'), with w, and of h alone.
struct Bent {
  double q[6], r[nw], curve;
};

// An interval whose length h is a variable.
struct Stretch {
  double f[nx];        // dx+ / dh
  double slope;        // of the cost
  Bent squared, more;  // of the Lagrangian: Gauss and Newton's part of the squares, and the rest
  double tau[nw];      // of e Q u
  double Y[nw][2];     // of h and of the time until the end of the phase
  double pulled_by_gap[2];
};

// The length of the intervals of a phase.
struct Length {
  std::size_t first, intervals;
  double given;
  double h, dh;
  double slope;    // of the cost, all but the intervals' own
  double bend[3];  // and with c at the node that ends the phase
  double E[nx], cross, pivot, pull;
  Slack<double> low, high;  // of h / given
};

// Interval k, and the node that begins it.
struct Stage {
  // Given.
  const Phase* phase;
  double h;
  int first_touch, touches;
  int hold;  // of it.holds; -1: none
  // Variables and what follows from them.
  double x[nx];
  double w[nw];
  double m[3];  // c + h/2 c' + h^2/6 g
  double gap[nx];
  double costate[nx];        // of the node that ends it
  double effort;             // per unit of h
  double own[4], before[4];  // the log-densities of the phase and of the one before: cost and slope in c per unit of h
  double q[nx];              // gradient of the cost
  double r[nw];
  Bend bend;
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
  bool bounded;
};

struct Iterate {
  std::vector<Stage> stages;  // one more than intervals: the last is the end node
  std::vector<Touch> touches;
  std::vector<Hold> holds;
  std::vector<Slack<v4>> loads;  // of u_n below its bound
  std::vector<Slack<double>> planes;
  std::vector<Length> lengths;     // empty: all as given
  std::vector<Stretch> stretches;  // as many as intervals where lengths are free
  double effort_share = 1.0;       // e: the effort of forces bends as if e Q u were its slope in h
  double nu_total = 0.0;
  double nu[nx] = {};      // multipliers of the end
  double nu_rest[3] = {};  // of F = (0, 0, 1) in the last interval
};

// f of all that lies in cones.
template <typename It, typename F>
void each_cone(It& it, F f) {
  for (auto& t : it.touches) f(t);
  for (auto& h : it.holds) f(h);
}

// f(slack, mask) for all slacks there are.
template <typename It, typename F>
void each_slack(It& it, F f) {
  for (auto& t : it.touches) {
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
}

}  // namespace stridelab
