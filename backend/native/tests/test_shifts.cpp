// Movable contacts: the step solves Newton's equations, the windows hold.
#include <algorithm>

#include "problems.hpp"
#include "stridelab_native/shifts.hpp"
#include "stridelab_native/solver.hpp"
#include "stridelab_native/steps.hpp"

using namespace stridelab;

namespace {

// The step with the foot that lands moved, and the one that stands alone.
Problem moving() {
  Problem p = step();
  p.places = {{1, 1, {{1, 0, 0}, {0, 1, 0}}, {-0.03, -0.02}, {0.03, 0.02}},
              {2, 2, {{0.8, 0.6, 0}, {-0.6, 0.8, 0}}, {-0.03, -0.02}, {0.03, 0.02}}};
  p.blocks[2].moved = 0;
  p.blocks[4].moved = 1;
  p.visits[1].moved = 1;
  p.visits.push_back(p.visits[0]);
  p.visits.push_back(p.visits[1]);
  p.visits[2].moved = 0;
  p.phases[1].first_visit = 2;
  p.phases[1].visits = 1;
  return p;
}

// Residual of the conditions after a Newton step, as a share of that before.
double left_after(double share) {
  const Problem given = moving();
  Iterate it;
  Settings rough;
  rough.tolerance = rough.gap = 1e-6;
  Problem fixed = given;
  fixed.places.clear();
  solve(fixed, it, rough);
  Problem moved = given;
  for (ContactBlock& t : it.contact_blocks) {
    t.block = &given.blocks[static_cast<std::size_t>(t.block - fixed.blocks.data())];
  }
  free_shifts(given, moved, it);
  evaluate(moved, it);
  initialise_slacks(it, 1e-2);
  evaluate(moved, it);
  const Conditions before = conditions(moved, it);
  scale_cones(it);
  const Penalty stiff{1e8, 1e6};
  expect(factor(moved, it, stiff, Theta{1.0, 1.0}), "the recursion is convex");
  set_targets(it, 1e-9, false);
  direction(moved, it, stiff);
  move_multipliers(moved, it, stiff, share);
  move(it, {share, share});
  evaluate(moved, it);
  const Conditions after = conditions(moved, it);
  return after.stationarity / before.stationarity;
}

// At the solution no other placement within the windows costs less.
void places_are_the_best() {
  const Problem p = moving();
  Iterate it;
  Settings exact;
  exact.gap = 1e-8;
  const Report best = solve(p, it, exact);
  expect(best.verdict == Verdict::solved, "contacts that may be moved: solved");
  for (std::size_t i = 0; i < p.places.size(); ++i) {
    for (int axis = 0; axis < 2; ++axis) {
      const double d = it.shifts[i].d[axis];
      expect(d > p.places[i].low[axis] && d < p.places[i].high[axis], "windows hold");
    }
  }
  const Iterate found = it;
  for (std::size_t i = 0; i < p.places.size(); ++i) {
    for (int axis = 0; axis < 2; ++axis) {
      for (double by : {-2e-3, 2e-3}) {
        const double d = found.shifts[i].d[axis] + by;
        if (d < p.places[i].low[axis] || d > p.places[i].high[axis]) continue;
        Problem other = p;
        for (std::size_t j = 0; j < p.places.size(); ++j) {
          for (int c = 0; c < 3; ++c) {
            double to = 0.0;
            for (int a = 0; a < 2; ++a) {
              to += p.places[j].axes[a][c] * (found.shifts[j].d[a] + (j == i && a == axis ? by : 0.0));
            }
            for (Block& b : other.blocks) b.p[c] += b.moved == static_cast<int>(j) ? to : 0.0;
            for (Visit& v : other.visits) v.place[c] += v.moved == static_cast<int>(j) ? to : 0.0;
          }
        }
        other.places.clear();
        Iterate given;
        const Report there = solve(other, given, exact);
        expect(there.verdict == Verdict::solved && there.cost > best.cost - 1e-6, "another place costs more");
      }
    }
  }
}

}  // namespace

int main() {
  for (double share : {1e-2, 1e-3, 1e-4}) {
    expect_near((1.0 - left_after(share)) / share, 1.0, 30.0 * share, "what a short step leaves");
  }
  places_are_the_best();
}
