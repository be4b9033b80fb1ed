#include <algorithm>
#include <cmath>

#include "stridelab_native/solver.hpp"
#include "stridelab_native/splines.hpp"

namespace stridelab {
namespace {

constexpr double slack_least = 0.02;

// The weight, without any effort.
WrenchControl upright(const WrenchCone& cone, double barrier) {
  WrenchControl hold{};
  hold.cone = &cone;
  hold.at.u[nw - 1] = 1.0;
  hold.at.z[nw - 1] = barrier;
  return hold;
}

}  // namespace

void cold_start(const Problem& problem, Iterate& it, double barrier) {
  std::size_t n = 0;
  std::size_t contact_blocks = 0;
  double total = 0.0;
  for (const Phase& phase : problem.phases) {
    n += static_cast<std::size_t>(phase.intervals);
    contact_blocks += static_cast<std::size_t>(phase.intervals * phase.blocks);
    total += phase.intervals * phase.h;
  }
  it.stages.assign(n + 1, Stage{});
  it.stages[n].hold = -1;
  it.contact_blocks.assign(contact_blocks, ContactBlock{});
  std::fill(it.nu, it.nu + nx, 0.0);
  std::fill(it.nu_rest, it.nu_rest + 3, 0.0);
  std::size_t k = 0;
  int slot = 0;
  int loads = 0;
  it.wrench_controls.clear();
  it.lengths.clear();
  it.shifts.clear();
  it.shift_uses.clear();
  it.free_intervals.clear();
  double time = 0.0;
  for (const Phase& phase : problem.phases) {
    int points = 0;
    for (int b = 0; b < phase.blocks; ++b) {
      points += problem.blocks[static_cast<std::size_t>(phase.first_block + b)].points;
    }
    for (int i = 0; i < phase.intervals; ++i, ++k) {
      Stage& s = it.stages[k];
      s.phase = &phase;
      s.h = phase.h;
      if (problem.shape == Shape::constant && !problem.limbs.empty()) {
        for (std::size_t c = 0; c < 3; ++c) s.limbs[c] = problem.limbs[3 * k + c];
      }
      if (problem.shape == Shape::constant && !problem.reference.empty()) {
        for (std::size_t c = 0; c < 3; ++c) s.reference[c] = problem.reference[3 * k + c];
      }
      s.first_contact_block = slot;
      s.hold = phase.cone < 0 ? -1 : static_cast<int>(it.wrench_controls.size());
      if (s.hold >= 0) {
        it.wrench_controls.push_back(upright(problem.cones[static_cast<std::size_t>(phase.cone)], barrier));
      }
      const bool node = problem.shape == Shape::constant || k % 2 == 0;
      s.bounded = k > 0 && node && !problem.heights.empty() && std::isfinite(problem.heights[k][0]);
      if (s.bounded) s.height = problem.heights[k];
      for (int c = 0; c < 3; ++c) s.x[c] = time / total * problem.goal[static_cast<std::size_t>(c)];
      time += phase.h;
      for (int b = 0; b < phase.blocks; ++b) {
        const Block& block = problem.blocks[static_cast<std::size_t>(phase.first_block + b)];
        if ((block.comes && i == 0) || (block.goes && i + 1 == phase.intervals)) continue;
        ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(slot++)];
        t.block = &block;
        const double share = 1.0 / points;
        t.at.u[2] = splat4(share);
        t.at.z[2] = splat4(barrier / share);
        t.load = std::isfinite(t.block->normal_max) ? loads++ : -1;
      }
      s.contact_blocks = slot - s.first_contact_block;
    }
  }
  it.contact_blocks.resize(static_cast<std::size_t>(slot));
  it.splines.clear();
  if (problem.shape == Shape::cubic) join(it);
  it.loads.assign(static_cast<std::size_t>(loads), Slack<v4>{});
  it.planes.assign(problem.planes.size(), Slack<double>{});
  for (int i = 0; i < nx; ++i) it.stages[n].x[i] = problem.goal[static_cast<std::size_t>(i)];
  for (int i = 0; i < nx; ++i) it.stages[0].x[i] = problem.start[static_cast<std::size_t>(i)];
}

void initialise_slacks(Iterate& it, double barrier) {
  each_slack(it, [&](auto& slack, auto) {
    const auto room = slack.s - slack.r;  // b - a
    slack.s = room > slack_least ? room : slack_least + 0.0 * room;
    slack.zeta = barrier / slack.s;
  });
}

}  // namespace stridelab
