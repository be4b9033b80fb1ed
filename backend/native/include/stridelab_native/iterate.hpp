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

// A block of points in one interval.
struct Touch {
  Cones at;
  Scaling scaling;
  v4 D_inverse[6];
  v4 target[3];  // W^-1 (lambda \ (sigma mu e - correction)): the part of the new z that does not depend on du
  v4 du[3];
  v4 dz[3];
  const Block* block;
  int load;  // of it.loads; -1: none
};

// Interval k, and the node that begins it.
struct Stage {
  // Given.
  const Phase* phase;
  double h;
  int first_touch, touches;
  // Variables and what follows from them.
  double x[nx];
  double w[nw];
  double m[3];  // c + h/2 c' + h^2/6 g
  double gap[nx];
  double q[nx];  // gradient of the cost
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
  std::vector<Slack<v4>> loads;  // of u_n below its bound
  std::vector<Slack<double>> planes;
  double nu[nx] = {};      // multipliers of the end
  double nu_rest[3] = {};  // of F = (0, 0, 1) in the last interval
};

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
}

}  // namespace stridelab
