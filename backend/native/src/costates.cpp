#include "stridelab_native/costates.hpp"

#include "stridelab_native/dynamics.hpp"
#include "stridelab_native/forces.hpp"

namespace stridelab {
namespace {

constexpr int symmetric[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};

// H (dx, dw) of the squares: their gradient with dl in place of l, and l with dF and dm in place of F and m.
void bent_by_squares(const Problem& problem, const Stage& s, double twist, double to_x[nx], double to_w[nw]) {
  const double h = s.h;
  const double wc = 2.0 * h * problem.w_acceleration * gravity * gravity;
  const double wl = 2.0 * h * problem.w_momentum;
  const double* F = s.w;
  const double* m = s.m;
  const double* dF = s.dw;
  double dm[3];
  for (int i = 0; i < 3; ++i) dm[i] = s.dx[i] + 0.5 * h * s.dx[3 + i];
  double l[3];
  double dl[3];
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    l[i] = twist * s.l[i];
    dl[i] = s.dw[3 + i] - (dm[j] * F[k] - dm[k] * F[j]) - (m[j] * dF[k] - m[k] * dF[j]);
  }
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    const double g = wl * (dl[j] * F[k] - dl[k] * F[j] + l[j] * dF[k] - l[k] * dF[j]);
    to_x[i] += g;
    to_x[3 + i] += 0.5 * h * g;
    to_w[i] += wc * dF[i] - wl * (dl[j] * m[k] - dl[k] * m[j] + l[j] * dm[k] - l[k] * dm[j]);
    to_w[3 + i] += wl * dl[i];
  }
}

}  // namespace

void follow_costates(const Problem& problem, Iterate& it, const Ending& end, const Penalty& penalty) {
  const std::size_t n = it.stages.size() - 1;
  double P[nx][nx];
  double costate[nx];
  end_hessian(problem, it, end, penalty, it.theta >= 1.0, P);
  end_gradient(problem, it, end, penalty, costate);
  for (int i = 0; i < nx; ++i) {
    for (int j = 0; j < nx; ++j) costate[i] += P[i][j] * it.stages[n].dx[j];
  }
  for (std::size_t k = n; k-- > 0;) {
    Stage& s = it.stages[k];
    double to_x[nx];
    double y[nw];
    pull_back(s.h, costate, to_x, y);
    for (int i = 0; i < nw; ++i) y[i] += s.r[i];
    if (k + 1 == n && end.rests) {
      for (int i = 0; i < 3; ++i) y[i] += it.nu_rest[i] + penalty.rest * (end.rest[i] + s.dw[i]);
    }
    for (int i = 0; i < nx; ++i) costate[i] = s.q[i] + to_x[i];
    bent_by_squares(problem, s, it.twist, costate, y);
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        const int e = symmetric[i][j];
        costate[i] += (s.log_density.majoriser[e] - it.theta * s.log_density.covariance[e]) * s.dx[j];
      }
    }
    if (s.bounded) costate[2] += s.high.zeta + s.high.dzeta - s.low.zeta - s.low.dzeta;
    if (s.hold < 0) follow_slope(it, s, y);
  }
}

}  // namespace stridelab
