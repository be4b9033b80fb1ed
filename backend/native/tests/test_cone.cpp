// Nesterov and Todd's scaling, and steps to the boundary, at random points.
#include "problems.hpp"
#include "stridelab_native/hold.hpp"

using namespace stridelab;

namespace {

// The cone of a wrench: the same formulas, and the root of D = W^-2 + e by its eigenvectors.
void of_six(std::mt19937& random) {
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  WrenchCone cone{};
  for (int i = 0; i < nw; ++i) {
    for (int j = 0; j < nw; ++j) cone.G[i][j] = any(random);
  }
  cone.effort = 0.3;
  WrenchControl hold{};
  hold.cone = &cone;
  double a[nw];
  for (auto* of : {&hold.at.u, &hold.at.z}) {
    for (double& x : *of) x = any(random);
    (*of)[nw - 1] = root(across(*of, *of)) + std::exp(4.0 * any(random) - 3.0);
  }
  for (double& x : a) x = any(random);
  scale(hold, 0.1);
  double once[nw];
  double twice[nw];
  unscale(hold.scaling, hold.at.u, once);
  for (int i = 0; i < nw; ++i) expect_near(once[i], hold.scaling.lambda[i], 1e-8 * once[nw - 1], "W^-1 u = W z");
  follow(hold, a);  // du = D^-1/2 a, so that a^T a = du^T D du
  unscale(hold.scaling, hold.du, once);
  expect_near(product(once, once) + 0.03 * product(hold.du, hold.du), product(a, a), 1e-8, "D^-1/2");
  double L[nw][8];
  root_of(hold, L);
  double w[nw] = {};
  add_wrench(hold, hold.du, w);
  for (int i = 0; i < nw; ++i) {
    double there = 0.0;
    for (int j = 0; j < nw; ++j) there += L[i][j] * a[j];
    expect_near(there, w[i], 1e-9, "L omega = G du");
  }
  unscale(hold.scaling, hold.du, once);
  const double far = longest(hold.scaling.lambda, once);
  if (far > 1e6) return;
  for (int i = 0; i < nw; ++i) twice[i] = hold.at.u[i] + far * hold.du[i];
  expect_near(root(across(twice, twice)), twice[nw - 1], 1e-5 * (1.0 + far), "the boundary");
}

}  // namespace

// Of a cone that is closed but for 1e-10: with the same weight on all, D has the eigenvectors of W.
void almost_closed() {
  const v4 away = splat4(1e-10);
  Cones c{};
  c.u[0] = splat4(0.6);
  c.u[1] = splat4(0.8);
  c.u[2] = 1.0 + away;
  c.z[0] = splat4(-60.0);
  c.z[1] = splat4(-80.0);
  c.z[2] = 100.0 + away;
  const Scaling<v4, 3> s = scaling(c);
  constexpr double e = 0.1;
  v4 I[6];
  invert(s, splat4(e), splat4(e), I);
  const double f = s.inverse_beta[0] * s.inverse_beta[0];
  const double size = std::hypot(s.w[0][0], s.w[1][0]);
  const double differentiate_length = (s.w[2][0] + size) * (s.w[2][0] + size);
  const double along = 0.5 / (e + f / differentiate_length);
  const double against = 0.5 / (e + f * differentiate_length);
  const double d[2] = {s.w[0][0] / size, s.w[1][0] / size};
  expect(differentiate_length > 1e9, "a cone that is almost closed");
  expect_near(I[5][0], along + against, 1e-6, "eta, eta");
  expect_near(I[2][0], (along - against) * d[0], 1e-6, "tau, eta");
  expect_near(I[4][0], (along - against) * d[1], 1e-6, "tau, eta");
  for (int i = 0; i < 2; ++i) {
    const double there = (along + against) * d[i] * d[i] + (1.0 - d[i] * d[i]) / (e + f);
    expect_near(I[i == 0 ? 0 : 3][0], there, 1e-6, "tau, tau");
  }
}

int main() {
  std::mt19937 random(1);
  for (int trial = 0; trial < 1000; ++trial) of_six(random);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  for (int trial = 0; trial < 1000; ++trial) {
    Cones c{};
    v4 a[3];
    for (int j = 0; j < 4; ++j) {
      for (v4(*cone)[3] : {&c.u, &c.z}) {
        auto& of = *cone;
        of[0][j] = any(random);
        of[1][j] = any(random);
        of[2][j] = std::hypot(of[0][j], of[1][j]) + std::exp(8.0 * any(random) - 6.0);
      }
      for (v4& of : a) of[j] = any(random);
    }
    const Scaling<v4, 3> s = scaling(c);
    v4 back[3];
    v4 twice[3];
    unscale(s, c.u, back);  // W^-1 u = lambda = W z
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 4; ++j) expect_near(back[i][j], s.lambda[i][j], 1e-6 * s.lambda[2][j], "W^-1 u = W z");
    }
    scale(s, a, back);
    unscale(s, back, twice);
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 4; ++j) expect_near(twice[i][j], a[i][j], 1e-6, "W^-1 W");
    }
    v4 E[6];
    v4 inverse[6];
    v4 once[3];
    inverse_square(s, E);
    E[0] += 0.1;
    E[3] += 0.1;
    E[5] += 0.2;
    invert(s, splat4(0.1), splat4(0.2), inverse);
    times(E, a, once);
    times(inverse, once, back);
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 4; ++j) expect_near(back[i][j], a[i][j], 1e-5, "inverse");
    }
    divide(s.lambda, a, back);
    expect_near(product(s.lambda, back)[1], a[2][1], 1e-9, "lambda o x");
    unscale(s, a, once);
    const v4 far = longest(s.lambda, once);  // along a from u
    for (int j = 0; j < 4; ++j) {
      if (far[j] > 1e6) continue;
      const double u[3] = {c.u[0][j] + far[j] * a[0][j], c.u[1][j] + far[j] * a[1][j], c.u[2][j] + far[j] * a[2][j]};
      expect_near(u[2] - std::hypot(u[0], u[1]), 0.0, 1e-5 * (1.0 + far[j]), "the boundary");
    }
  }
  almost_closed();
  return 0;
}
