// Forces that are splines: derivatives of the cost against differences, a Newton step against the equations that it
// solves, and whole solves.
#include <vector>

#include "full_step.hpp"
#include "problems.hpp"
#include "stridelab_native/solver.hpp"
#include "stridelab_native/splines.hpp"
#include "stridelab_native/steps.hpp"

using namespace stridelab;

namespace {

// The step by splines, its phases of different rates; the right foot goes and comes.
Problem splines(double air_s = 0.0) {
  Problem p = step(air_s);
  p.shape = Shape::cubic;
  double rate = 1.0;
  for (Phase& f : p.phases) {
    f.intervals *= 2;
    f.h *= 0.5 * rate;
    rate += 0.2;
  }
  p.blocks[1].goes = true;
  p.blocks[4].comes = true;
  if (air_s > 0.0) {
    p.blocks[0].goes = p.blocks[1].goes = true;
    p.blocks[2].comes = true;
  }
  return p;
}

void stir(Iterate& it) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  for (std::size_t k = 2; k < it.stages.size(); k += 2) {
    for (double& x : it.stages[k].x) x += 0.02 * any(random);
  }
  for (ContactBlock& t : it.contact_blocks) {
    for (int j = 0; j < 4; ++j) {
      for (int i = 0; i < 2; ++i) t.at.u[i][j] += 0.04 * any(random);
      t.at.z[0][j] += 0.1 * any(random);
    }
  }
}

void no_forces_beside_what_comes_and_goes() {
  const Problem p = splines();
  Iterate it;
  cold_start(p, it, 1.0);
  expect(it.stages[12].contact_blocks == 2 && it.stages[13].contact_blocks == 1, "the right foot goes");
  expect(it.stages[30].contact_blocks == 1 && it.stages[31].contact_blocks == 2, "and comes");
  expect(it.contact_blocks.size() == 13 * 2 + 1 + 16 + 1 + 19 * 2, "and nothing is left over");
}

void derivatives() {
  const Problem p = splines();
  Iterate it;
  cold_start(p, it, 1.0);
  stir(it);
  evaluate(p, it);
  const std::vector<Stage> at = it.stages;
  constexpr double by = 1e-6;
  const auto difference = [&](double& of) {
    const double was = of;
    of = was + by;
    const double up = evaluate(p, it);
    of = was - by;
    const double down = evaluate(p, it);
    of = was;
    return (up - down) / (2.0 * by);
  };
  for (std::size_t k : {std::size_t{0}, std::size_t{2}, std::size_t{14}, std::size_t{44}}) {
    for (int i = 0; i < nx; ++i) {
      expect_near(at[k].q[i], difference(it.stages[k].x[i]), 1e-6 * std::fabs(at[k].q[i]) + 2e-2, "dcost / dx");
    }
  }
  for (std::size_t k : {std::size_t{0}, std::size_t{13}, std::size_t{14}, std::size_t{25}, std::size_t{49}}) {
    ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(it.stages[k].first_contact_block)];
    const Block& b = *t.block;
    for (int i = 0; i < 3; ++i) {
      const double f[3] = {b.S[i], b.S[3 + i], b.S[6 + i]};
      const double m[3] = {b.p[1][2] * f[2] - b.p[2][2] * f[1], b.p[2][2] * f[0] - b.p[0][2] * f[2],
                           b.p[0][2] * f[1] - b.p[1][2] * f[0]};
      double slope = it.stages[k].h * b.effort[i == 2] * t.at.u[i][2];
      for (int c = 0; c < 3; ++c) slope += at[k].r[c] * f[c] + at[k].r[3 + c] * m[c];
      const v4 was = t.at.u[i];
      t.at.u[i][2] = was[2] + by;
      const double up = evaluate(p, it);
      t.at.u[i][2] = was[2] - by;
      const double down = evaluate(p, it);
      t.at.u[i] = was;
      expect_near(slope, (up - down) / (2.0 * by), 1e-6 * std::fabs(slope) + 2e-2, "dcost / du");
    }
  }
}

// After a full step the linear equations hold, and Newton's conditions: the slope along every force is what its cone
// leaves of it, with the curvature of Gauss and Newton, which is exact where the momentum costs nothing.
void step_solves(Problem p) {
  p.w_momentum = 0.0;
  p.w_likelihood = 0.0;
  Iterate it;
  cold_start(p, it, 1.0);
  stir(it);
  evaluate(p, it);
  initialise_slacks(it, 1.0);
  evaluate(p, it);
  const Penalty penalty{1e8, 1e6};
  scale_cones(it);
  expect(factor(p, it, penalty, Theta{1.0, 0.0}), "squares are convex");
  set_targets(it, 0.5, false);
  direction(p, it, penalty);
  const std::vector<double> wrenches = wrenches_ahead(it);
  move_multipliers(p, it, penalty, 1.0);
  move(it, {1.0, 1.0});
  evaluate(p, it);
  expect_taken(it, wrenches);
  const Conditions c = conditions(p, it);
  expect_near(c.stationarity, 0.0, 1e-4, "slope of the Lagrangian after a full step");
  const Ending end = ending(p, it);
  for (double e : end.miss) expect_near(e, 0.0, 1e-3, "the end after a full step");
}

void solved(const Problem& p, const char* what) {
  Iterate it;
  const Report r = solve(p, it, Settings{});
  expect(r.verdict == Verdict::solved, what);
  expect(r.iterations <= 30, what);
  expect(r.conditions.feasibility < 1e-9, what);
}

}  // namespace

int main() {
  no_forces_beside_what_comes_and_goes();
  derivatives();
  step_solves(splines());
  step_solves(splines(0.1));
  Problem bounded = splines();
  bound_heights(bounded, 0.1);
  for (Block& b : bounded.blocks) b.normal_max = 0.6;
  step_solves(bounded);
  solved(splines(), "a step by splines");
  solved(splines(0.1), "a hop by splines");
  solved(bounded, "a bounded step by splines");
  Problem far = splines();
  far.goal[0] = 30.0;
  Iterate it;
  expect(solve(far, it, Settings{}).verdict == Verdict::infeasible, "30 m in 2.5 s cannot be");
  return 0;
}
