// Whole solves: they converge, deterministically and within bounds; infeasible problems are distinguished from failed
// solves.
#include <cstring>

#include "problems.hpp"
#include "stridelab_native/solver.hpp"

using namespace stridelab;

namespace {

Report solved(const Problem& p, Iterate& it, const char* what) {
  const Report r = solve(p, it, Settings{});
  expect(r.verdict == Verdict::solved, what);
  expect(r.iterations <= 30, what);
  expect(r.conditions.feasibility < 1e-9, what);
  expect(r.conditions.stationarity * objective_scale < 2e-5, what);
  return r;
}

void bounds_hold() {
  Problem p = step();
  Iterate it;
  const double free_cost = solved(p, it, "a step").cost;
  bound_heights(p, 0.004);
  p.blocks[2].normal_max = 0.4;
  const double cost = solved(p, it, "a bounded step").cost;
  expect(cost >= free_cost - 1e-6, "bounds cost something");
  for (std::size_t k = 1; k + 1 < it.stages.size(); ++k) expect(std::fabs(it.stages[k].x[2]) <= 0.004 + 1e-8, "height");
  for (const ContactBlock& t : it.contact_blocks) {
    for (int j = 0; j < 4; ++j) expect(t.at.u[2][j] <= t.block->normal_max + 1e-8, "normal force");
  }
}

void moved() {
  Problem p = step();
  p.end = End::moving;
  p.goal[3] = 0.2;
  p.goal[7] = 0.01;
  Iterate it;
  solved(p, it, "a moving end");
  for (int i = 0; i < nx; ++i) expect_near(it.stages.back().x[i], p.goal[static_cast<std::size_t>(i)], 1e-9, "goal");
}

void captured() {
  Problem p = step();
  p.end = End::capturable;
  const double omega = std::sqrt(gravity / 0.8);
  p.planes = {{{1, 0, 1 / omega, 0}, 0.25},
              {{-1, 0, -1 / omega, 0}, 0.05},
              {{0, 1, 0, 1 / omega}, 0.1},
              {{0, -1, 0, -1 / omega}, 0.1}};
  p.start[3] = 0.3;
  Iterate it;
  solved(p, it, "a capturable end");
  const double* x = it.stages.back().x;
  expect_near(x[2], 0.0, 1e-9, "height of the end");
  expect_near(x[8], (x[0] * x[4] - x[1] * x[3]) / gravity, 1e-9, "momentum of the end");
  p.start[3] = 40.0;
  expect(solve(p, it, Settings{}).verdict == Verdict::infeasible, "40 m/s cannot be captured in 2.5 s");
  bound_heights(p, 0.05);
  p.start[3] = 8.0;
  expect(solve(p, it, Settings{}).verdict == Verdict::infeasible, "nor 8 m/s at this height");
}

void free_lengths_cost_less() {
  Problem p = step();
  Iterate it;
  const double given = solve(p, it, Settings{}).cost;
  p.length_limits = {true, 0.6, 1.6, 2.5, 0.0};
  const Report r = solve(p, it, Settings{});
  expect(r.verdict == Verdict::solved, "free lengths");
  expect(r.cost < given - 0.1, "free lengths cost less");
  double total = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    const Length& l = it.lengths[i];
    expect(l.h > 0.06 - 1e-9 && l.h < 0.16 + 1e-9, "within their bounds");
    total += l.h * static_cast<double>(l.intervals);
    p.phases[i].h = l.h;
  }
  expect_near(total, 2.5, 1e-9, "the same time altogether");
  p.length_limits.lengths = false;
  expect_near(solved(p, it, "the same lengths, given").cost, r.cost, 1e-5, "cost of the same lengths, given");
  p = step();
  p.length_limits = {true, 0.6, 1.6, unbounded, 2.0};
  expect(solve(p, it, Settings{}).verdict == Verdict::solved, "free lengths at a price");
  p.goal[0] = 30.0;
  expect(solve(p, it, Settings{}).verdict != Verdict::solved, "30 m in 4 s");
}

void warm_is_shorter() {
  const Problem p = step();
  Iterate it;
  const int cold = solved(p, it, "a step").iterations;
  Settings warm;
  warm.warm = true;
  expect(solve(p, it, warm).iterations < cold, "the solution itself is a good start");
}

}  // namespace

int main() {
  Iterate a;
  Iterate b;
  const Report first = solved(step(), a, "a step");
  solved(step(), b, "a step");
  expect(std::memcmp(a.stages[10].x, b.stages[10].x, sizeof a.stages[10].x) == 0, "the same bits twice");
  expect(first.iterations <= 15, "a step is easy");
  Iterate it;
  solved(step(0.1), it, "a hop");
  solved(wrench_step(), it, "a step by wrenches");
  for (const WrenchControl& h : it.wrench_controls) {
    expect(root(across(h.at.u, h.at.u)) < h.at.u[nw - 1], "wrenches in their cones");
  }
  Problem far_away = wrench_step();
  far_away.goal[0] = 30.0;
  expect(solve(far_away, it, Settings{}).verdict == Verdict::infeasible,
         "30 m in 2.5 s cannot be, by wrenches neither");
  bounds_hold();
  captured();
  moved();
  free_lengths_cost_less();
  warm_is_shorter();

  Problem far = step();
  far.goal[0] = 30.0;
  const Report impossible = solve(far, it, Settings{});
  expect(impossible.verdict == Verdict::infeasible, "30 m in 2.5 s cannot be");

  Problem in_the_air = step();
  in_the_air.phases.back().blocks = 0;
  expect(solve(in_the_air, it, Settings{}).verdict == Verdict::infeasible, "nothing stands in the air");

  Problem nothing = step();
  nothing.goal[1] = std::nan("");
  expect(solve(nothing, it, Settings{}).verdict == Verdict::not_finite, "NaN is told");

  Settings short_of_time;
  short_of_time.iterations = 2;
  expect(solve(step(), it, short_of_time).verdict != Verdict::solved, "two iterations are not enough");
  return 0;
}
