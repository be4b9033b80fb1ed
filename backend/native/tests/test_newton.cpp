// The derivatives of the cost against differences, and a Newton step against the equations that it solves.
#include <vector>

#include "problems.hpp"
#include "stridelab_native/dynamics.hpp"
#include "stridelab_native/evaluate.hpp"
#include "stridelab_native/solver.hpp"
#include "stridelab_native/steps.hpp"

using namespace stridelab;

namespace {

void stir(Iterate& it) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  for (std::size_t k = 1; k < it.stages.size(); ++k) {
    for (double& x : it.stages[k].x) x += 0.02 * any(random);
  }
  for (Touch& t : it.touches) {
    for (int j = 0; j < 4; ++j) {
      t.at.u[0][j] += 0.05 * any(random);
      t.at.u[1][j] += 0.05 * any(random);
      t.at.z[0][j] += 0.1 * any(random);
    }
  }
}

void derivatives(const Problem& p) {
  Iterate it;
  cold_start(p, it, 1.0);
  stir(it);
  evaluate(p, it);
  const std::vector<Stage> at = it.stages;
  constexpr double by = 1e-6;
  for (std::size_t k : {std::size_t{3}, std::size_t{7}, std::size_t{20}}) {
    for (int i = 0; i < nx; ++i) {
      it.stages[k].x[i] += by;
      const double up = evaluate(p, it);
      it.stages[k].x[i] -= 2.0 * by;
      const double down = evaluate(p, it);
      it.stages[k].x[i] += by;
      expect_near(at[k].q[i], (up - down) / (2.0 * by), 1e-6 * std::fabs(at[k].q[i]) + 2e-2, "dcost / dx");
    }
    Touch& t = it.touches[static_cast<std::size_t>(it.stages[k].first_touch)];
    const Block& b = *t.block;
    for (int i = 0; i < 3; ++i) {
      const double f[3] = {b.S[i], b.S[3 + i], b.S[6 + i]};
      const double m[3] = {b.p[1][2] * f[2] - b.p[2][2] * f[1], b.p[2][2] * f[0] - b.p[0][2] * f[2],
                           b.p[0][2] * f[1] - b.p[1][2] * f[0]};
      double slope = it.stages[k].h * b.effort[i == 2] * t.at.u[i][2];
      for (int c = 0; c < 3; ++c) slope += at[k].r[c] * f[c] + at[k].r[3 + c] * m[c];
      t.at.u[i][2] += by;
      const double up = evaluate(p, it);
      t.at.u[i][2] -= 2.0 * by;
      const double down = evaluate(p, it);
      t.at.u[i][2] += by;
      expect_near(slope, (up - down) / (2.0 * by), 1e-6 * std::fabs(slope) + 2e-2, "dcost / du");
    }
  }
}

// After a full step the linear equations hold: the gaps are closed, and the forces make the wrench.
void step_closes_the_gaps(const Problem& p) {
  Iterate it;
  cold_start(p, it, 1.0);
  stir(it);
  evaluate(p, it);
  loosen(it, 1.0);
  evaluate(p, it);
  const Penalty penalty{1e8, 1e6};
  scale_cones(it);
  expect(factor(p, it, penalty, 0.0), "the majoriser is convex");
  aim(it, 0.5, false);
  direction(p, it, penalty);
  std::vector<double> wrenches;
  for (const Stage& s : it.stages) {
    for (int i = 0; i < nw; ++i) wrenches.push_back(s.w[i] + s.dw[i]);
  }
  move(it, {1.0, 1.0});
  evaluate(p, it);
  for (std::size_t k = 0; k + 1 < it.stages.size(); ++k) {
    for (int i = 0; i < nx; ++i) expect_near(it.stages[k].gap[i], 0.0, 1e-9, "gap after a full step");
    for (int i = 0; i < nw; ++i) {
      expect_near(it.stages[k].w[i], wrenches[k * nw + static_cast<std::size_t>(i)], 1e-8, "wrench");
    }
  }
  const Ending end = ending(p, it);
  for (double e : end.miss) expect_near(e, 0.0, 1e-3, "the end after a full step");
}

}  // namespace

int main() {
  derivatives(step());
  step_closes_the_gaps(step());
  step_closes_the_gaps(step(0.1));
  Problem bounded = step();
  for (Phase& f : bounded.phases) {
    f.height[0] = -0.1;
    f.height[1] = 0.1;
  }
  for (Block& b : bounded.blocks) b.normal_max = 0.6;
  step_closes_the_gaps(bounded);
  return 0;
}
