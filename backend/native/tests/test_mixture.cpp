// The exponential, and the log-density against differences of itself.
#include "problems.hpp"
#include "stridelab_native/mixture.hpp"

using namespace stridelab;

int main() {
  for (double x : {0.0, -1e-9, -0.3, -1.0, -17.5, -350.0, -699.0}) {
    const double e = exponential(splat8(x))[3];
    expect_near(e / std::exp(x), 1.0, 4e-16, "e^x");
  }
  expect(exponential(splat8(-1e300))[0] < 1e-300, "what is far away counts for nothing");

  const Density d = density();
  const Visit at{0, {0.05, -0.02, 0.01}, {0.8, -0.6, 0.0, 0.6, 0.8, 0.0, 0.0, 0.0, 1.0}};
  const double c[3] = {0.03, 0.04, -0.05};
  DensityDerivatives log_density{};
  visit(at, d, c, 0.7, log_density);
  constexpr int entry[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
  constexpr double by = 1e-5;
  for (int i = 0; i < 3; ++i) {
    DensityDerivatives ahead{};
    DensityDerivatives behind{};
    double there[3] = {c[0], c[1], c[2]};
    there[i] += by;
    const double up = visit(at, d, there, 0.7, ahead);
    there[i] -= 2.0 * by;
    const double down = visit(at, d, there, 0.7, behind);
    expect_near(log_density.gradient[i], (up - down) / (2.0 * by), 1e-6, "gradient");
    for (int j = 0; j < 3; ++j) {
      const double slope = (ahead.gradient[j] - behind.gradient[j]) / (2.0 * by);
      expect_near(log_density.majoriser[entry[i][j]] - log_density.covariance[entry[i][j]], slope, 1e-5, "curvature");
    }
  }
  return 0;
}
