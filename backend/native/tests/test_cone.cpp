// Nesterov and Todd's scaling, and steps to the boundary, at random points.
#include "problems.hpp"
#include "stridelab_native/cone.hpp"

using namespace stridelab;

int main() {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  for (int trial = 0; trial < 1000; ++trial) {
    Cones c{};
    v4 a[3];
    for (int j = 0; j < 4; ++j) {
      for (v4* of : {c.u, c.z}) {
        of[0][j] = any(random);
        of[1][j] = any(random);
        of[2][j] = std::hypot(of[0][j], of[1][j]) + std::exp(8.0 * any(random) - 6.0);
      }
      for (v4& of : a) of[j] = any(random);
    }
    const Scaling s = scaling(c);
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
    invert(E, inverse);
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
  return 0;
}
