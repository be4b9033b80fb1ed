#include "stridelab_native/ending.hpp"

#include <algorithm>
#include <cmath>

#include "stridelab_native/lengths.hpp"

namespace stridelab {
namespace {

constexpr int captured[4] = {0, 1, 3, 4};

}  // namespace

Ending ending(const Problem& problem, const Iterate& it) {
  Ending e{};
  const std::size_t n = it.stages.size() - 1;
  const double* x = it.stages[n].x;
  const double* goal = problem.goal.data();
  if (problem.end == End::rest || problem.end == End::moving) {
    e.rows = nx;
    e.rests = problem.end == End::rest;
    for (int i = 0; i < nx; ++i) {
      e.miss[i] = x[i] - goal[i];
      e.J[i][i] = 1.0;
    }
    for (int i = 0; e.rests && i < 3; ++i) e.rest[i] = it.stages[n - 1].w[i] - (i == 2 ? 1.0 : 0.0);
    return e;
  }
  e.rows = problem.end == End::upright ? 4 : 5;
  e.miss[0] = x[2] - goal[2];
  e.miss[1] = x[5] - goal[5];
  e.J[0][2] = e.J[1][5] = 1.0;
  if (problem.end == End::upright) {  // with c_z and c'_z of the goal, c x c' is linear across the vertical
    e.miss[2] = x[6] - (x[1] * goal[5] - goal[2] * x[4]) / gravity;
    e.miss[3] = x[7] - (goal[2] * x[3] - x[0] * goal[5]) / gravity;
    e.J[2][6] = e.J[3][7] = 1.0;
    e.J[2][4] = goal[2] / gravity;
    e.J[3][3] = -goal[2] / gravity;
    e.J[2][1] = -goal[5] / gravity;
    e.J[3][0] = goal[5] / gravity;
    return e;
  }
  // L_c / (m g) = K - c x c' / g
  const double* c = x;
  const double* v = x + 3;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    e.miss[2 + i] = x[6 + i] - (c[j] * v[k] - c[k] * v[j]) / gravity;
    e.J[2 + i][6 + i] = 1.0;
    e.J[2 + i][j] = -v[k] / gravity;
    e.J[2 + i][k] = v[j] / gravity;
    e.J[2 + i][3 + k] = -c[j] / gravity;
    e.J[2 + i][3 + j] = c[k] / gravity;
  }
  return e;
}

void end_hessian(const Problem& problem, const Iterate& it, const Ending& end, const Penalty& penalty,
                 bool exact_curvature, double P[nx][nx]) {
  for (int i = 0; i < nx; ++i) {
    for (int j = 0; j < nx; ++j) {
      P[i][j] = 0.0;
      for (int r = 0; r < end.rows; ++r) P[i][j] += penalty.end * end.J[r][i] * end.J[r][j];
    }
  }
  for (int i = 0; exact_curvature && problem.end == End::capturable && i < 3; ++i) {  // -nu . (c x c') / g
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    const double curve = it.nu[2 + i] / gravity;
    P[j][3 + k] -= curve;
    P[3 + k][j] -= curve;
    P[k][3 + j] += curve;
    P[3 + j][k] += curve;
  }
  for (std::size_t a = 0; a < it.planes.size(); ++a) {
    const double* normal = problem.planes[a].normal;
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) P[captured[i]][captured[j]] += it.planes[a].weight() * normal[i] * normal[j];
    }
  }
}

void end_gradient(const Problem& problem, const Iterate& it, const Ending& end, const Penalty& penalty, double p[nx]) {
  std::copy(it.stages.back().q, it.stages.back().q + nx, p);
  for (int r = 0; r < end.rows; ++r) {
    for (int i = 0; i < nx; ++i) p[i] += end.J[r][i] * (it.nu[r] + penalty.end * end.miss[r]);
  }
  for (std::size_t a = 0; a < it.planes.size(); ++a) {
    for (int i = 0; i < 4; ++i) p[captured[i]] += it.planes[a].pull() * problem.planes[a].normal[i];
  }
}

void end_costate(const Problem& problem, const Iterate& it, const Ending& end, double costate[nx]) {
  std::copy(it.stages.back().q, it.stages.back().q + nx, costate);
  for (int r = 0; r < end.rows; ++r) {
    for (int i = 0; i < nx; ++i) costate[i] += end.J[r][i] * it.nu[r];
  }
  for (std::size_t a = 0; a < it.planes.size(); ++a) {
    for (int i = 0; i < 4; ++i) costate[captured[i]] += it.planes[a].zeta * problem.planes[a].normal[i];
  }
}

void end_steps(const Problem& problem, Iterate& it) {
  for (std::size_t a = 0; a < it.planes.size(); ++a) {
    it.planes[a].follow(capture(problem.planes[a], it.stages.back().dx));
  }
}

void move_multipliers(const Problem& problem, Iterate& it, const Penalty& penalty, double share) {
  const Ending end = ending(problem, it);
  const std::size_t n = it.stages.size() - 1;
  for (int r = 0; r < end.rows; ++r) {
    double miss = end.miss[r];
    for (int i = 0; i < nx; ++i) miss += end.J[r][i] * it.stages[n].dx[i];
    it.nu[r] += share * penalty.end * miss;
  }
  double total = total_length_error(problem, it);
  for (const Length& l : it.lengths) total += static_cast<double>(l.intervals) * l.dh;
  if (std::isfinite(problem.length_limits.total)) it.nu_total += share * penalty.end * total;
  if (!end.rests) return;
  for (int i = 0; i < 3; ++i) it.nu_rest[i] += share * penalty.rest * (end.rest[i] + it.stages[n - 1].dw[i]);
}

}  // namespace stridelab
