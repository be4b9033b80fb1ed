// The derivatives of the cost against differences, and a Newton step against the equations that it solves.
#include <vector>

#include "full_step.hpp"
#include "problems.hpp"
#include "stridelab_native/dynamics.hpp"
#include "stridelab_native/evaluate.hpp"
#include "stridelab_native/lengths.hpp"
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
  for (ContactBlock& t : it.contact_blocks) {
    for (int j = 0; j < 4; ++j) {
      t.at.u[0][j] += 0.05 * any(random);
      t.at.u[1][j] += 0.05 * any(random);
      t.at.z[0][j] += 0.1 * any(random);
    }
  }
  for (WrenchControl& h : it.wrench_controls) {
    for (int i = 0; i < nw; ++i) h.at.u[i] += 0.05 * any(random);
    for (int i = 0; i < nw; ++i) h.at.z[i] += 0.1 * any(random);
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
    ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(it.stages[k].first_contact_block)];
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
  initialise_slacks(it, 1.0);
  evaluate(p, it);
  const Penalty penalty{1e8, 1e6};
  scale_cones(it);
  expect(factor(p, it, penalty, Theta{0.0, 0.0}), "the majoriser is convex");
  set_targets(it, 0.5, false);
  direction(p, it, penalty);
  const std::vector<double> wrenches = wrenches_ahead(it);
  move(it, {1.0, 1.0});
  evaluate(p, it);
  expect_taken(it, wrenches);
  const Ending end = ending(p, it);
  for (double e : end.miss) expect_near(e, 0.0, 1e-3, "the end after a full step");
}

// Derivatives in a length: slope and second derivatives of cost + costate^T x+ against differences.
void lengths() {
  Problem p = step();
  p.length_limits = {true, 0.6, 1.6, 2.5, 0.0};
  Iterate it;
  cold_start(p, it, 1.0);
  free_lengths(p, it);
  stir(it);
  const double cost = evaluate(p, it);
  constexpr double by = 1e-6;
  constexpr std::size_t k = 8;
  Stage& s = it.stages[k];
  for (int i = 0; i < nx; ++i) s.costate[i] = std::sin(1.0 + i) * 1e3;
  const auto whole = [&] {
    double all = evaluate(p, it);
    for (int i = 0; i < nx; ++i) all += s.costate[i] * s.gap[i];
    return all;
  };
  FreeInterval at{};
  const double slope = differentiate_length(p, s, at);
  const auto difference = [&](double& of, auto value) {
    const double was = of;
    of = was + by;
    const double up = value();
    of = was - by;
    const double down = value();
    of = was;
    evaluate(p, it);
    return (up - down) / (2.0 * by);
  };
  const auto close = [&](double a, double b, const char* what) {
    expect_near(a, b, 1e-6 * (std::fabs(cost) + std::fabs(a)), what);
  };
  const auto sloped = [&] {
    evaluate(p, it);
    FreeInterval of{};
    return differentiate_length(p, s, of);
  };
  close(slope, difference(s.h, whole), "d / dh");
  close(at.squared.curve + at.more.curve, difference(s.h, sloped), "d2 / dh2");
  for (int i = 0; i < 6; ++i) close(at.squared.q[i] + at.more.q[i], difference(s.x[i], sloped), "d2 / dh dx");
  ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(s.first_contact_block)];
  const Block& b = *t.block;
  double r[nw];
  for (int i = 0; i < nw; ++i) r[i] = at.squared.r[i] + at.more.r[i];
  const double points[3] = {b.p[0][1], b.p[1][1], b.p[2][1]};
  const double e[3] = {r[0] + r[4] * points[2] - r[5] * points[1], r[1] + r[5] * points[0] - r[3] * points[2],
                       r[2] + r[3] * points[1] - r[4] * points[0]};
  for (int i = 0; i < 3; ++i) {
    const double with_u = b.S[i] * e[0] + b.S[3 + i] * e[1] + b.S[6 + i] * e[2] + t.effort(i) * t.at.u[i][1];
    const v4 was = t.at.u[i];
    t.at.u[i][1] += by;
    const double up = sloped();
    t.at.u[i][1] -= 2.0 * by;
    const double down = sloped();
    t.at.u[i] = was;
    close(with_u, (up - down) / (2.0 * by), "d2 / dh du");
  }
}

// A full step meets the total and, to second order in the step, the dynamics of the new lengths.
void lengths_step(const Problem& given) {
  Problem p = given;
  p.length_limits = {true, 0.6, 1.6, 2.6, 0.0};
  Iterate it;
  cold_start(p, it, 1.0);
  free_lengths(p, it);
  evaluate(p, it);
  initialise_slacks(it, 1.0);
  evaluate(p, it);
  conditions(p, it);
  const Penalty penalty{1e8, 1e6};
  scale_cones(it);
  expect(factor(p, it, penalty, Theta{0.0, 0.0}), "Gauss and Newton's part is convex");
  set_targets(it, 0.5, false);
  direction(p, it, penalty);
  std::vector<Stage> at = it.stages;
  constexpr double small = 1e-4;
  move(it, {small, small});
  evaluate(p, it);
  for (std::size_t k = 0; k + 1 < it.stages.size(); ++k) {
    for (int i = 0; i < nx; ++i) {
      expect_near(it.stages[k].gap[i], (1.0 - small) * at[k].gap[i], 1e-6, "gaps shrink as the step says");
    }
    for (int i = 0; i < nw; ++i) expect_near(it.stages[k].w[i], at[k].w[i] + small * at[k].dw[i], 1e-9, "wrench");
  }
  double total = total_length_error(p, it);
  for (const Length& l : it.lengths) total += (1.0 - small) * static_cast<double>(l.intervals) * l.dh;
  expect_near(total, 0.0, 1e-3, "the total after a full step");
}

}  // namespace

int main() {
  lengths();
  lengths_step(step());
  lengths_step(wrench_step());
  derivatives(step());
  step_closes_the_gaps(step());
  step_closes_the_gaps(step(0.1));
  step_closes_the_gaps(wrench_step());
  Problem bounded = step();
  bound_heights(bounded, 0.1);
  for (Block& b : bounded.blocks) b.normal_max = 0.6;
  step_closes_the_gaps(bounded);
  return 0;
}
