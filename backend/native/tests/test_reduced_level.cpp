// A level in the null space of the rows above it: what defines it, with rows that repeat and rows that contradict.
#include <cmath>
#include <cstdio>
#include <vector>

#include "problems.hpp"
#include "stridelab_native/reduced_level.hpp"

using namespace stridelab;

namespace {

constexpr std::size_t n = 23;

struct Matrix {
  std::size_t m;
  std::vector<double> A, b;

  Matrix(std::size_t rows, std::mt19937& random, double density) : m(rows), A(rows * n), b(rows) {
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform;
    for (double& x : A) x = uniform(random) < density ? normal(random) : 0.0;
    for (double& x : b) x = normal(random);
  }

  View matrix() const { return {A.data(), static_cast<std::ptrdiff_t>(n), 1}; }
  LinearRows rows() const { return {matrix(), {b.data(), 1, 0}, m}; }

  std::vector<double> times(const std::vector<double>& x) const {
    std::vector<double> y(m);
    for (std::size_t i = 0; i < m; ++i) {
      for (std::size_t j = 0; j < n; ++j) y[i] += A[i * n + j] * x[j];
    }
    return y;
  }
};

double cost(const Matrix& level, const std::vector<double>& x) {
  const std::vector<double> y = level.times(x);
  double sum = 0.0;
  for (std::size_t i = 0; i < level.m; ++i) sum += 0.5 * (y[i] - level.b[i]) * (y[i] - level.b[i]);
  return sum;
}

// At a random w: the rows above hold, the cost and the bounds are those of z + Z w.
void reduction_holds(const std::vector<const Matrix*>& above, std::size_t rank, std::mt19937& random) {
  const Matrix level(30, random, 0.1), bounds(40, random, 0.2);
  std::vector<double> lower(bounds.m, -3.0), upper(bounds.m, 4.0);
  lower[0] = -std::numeric_limits<double>::infinity();
  std::vector<LinearRows> blocks;
  blocks.reserve(above.size());
  for (const Matrix* one : above) blocks.push_back(one->rows());
  ReducedLevel made;
  const BoundRows given{bounds.matrix(), {lower.data(), 1, 0}, {upper.data(), 1, 0}, bounds.m};
  expect(reduce_level(n, blocks, level.rows(), given, made), "the rows agree");
  expect(made.k == n - rank, "size of the null space");
  std::normal_distribution<double> normal;
  std::vector<double> w(made.k), x = made.z;
  for (double& one : w) one = normal(random);
  double size_w = 0.0, size_step = 0.0, linear = 0.0, quadratic = 0.0;
  for (std::size_t j = 0; j < n; ++j) {
    double step = 0.0;
    for (std::size_t i = 0; i < made.k; ++i) step += made.Z[j * made.k + i] * w[i];
    x[j] += step;
    size_step += step * step;
  }
  for (std::size_t i = 0; i < made.k; ++i) {
    size_w += w[i] * w[i];
    linear += made.f[i] * w[i];
    for (std::size_t j = 0; j < made.k; ++j) quadratic += 0.5 * w[i] * made.H[i * made.k + j] * w[j];
  }
  expect_near(size_step, size_w, 1e-10, "the basis is orthonormal");
  expect_near(cost(level, made.z) + linear + quadratic, cost(level, x), 1e-8, "cost");
  for (const Matrix* one : above) {
    const std::vector<double> y = one->times(x);
    for (std::size_t i = 0; i < one->m; ++i) expect_near(y[i], one->b[i], 1e-10, "a row above");
  }
  const std::vector<double> y = bounds.times(x);
  for (std::size_t i = 0; i < bounds.m; ++i) {
    double moved = 0.0;
    for (std::size_t j = 0; j < made.k; ++j) moved += made.C[i * made.k + j] * w[j];
    expect_near(made.upper[i] - moved, 4.0 - y[i], 1e-10, "room above");
    if (i > 0) expect_near(made.lower[i] - moved, -3.0 - y[i], 1e-10, "room below");
  }
  expect(made.lower[0] == -1e30, "a missing bound");
}

void every_rank_is_handled() {
  std::mt19937 random(5);
  const Matrix first(7, random, 1.0), second(4, random, 0.4);
  const Matrix whole(n, random, 1.0), none(0, random, 1.0);
  reduction_holds({&first}, 7, random);
  reduction_holds({&first, &second}, 11, random);
  reduction_holds({&first, &second, &first}, 11, random);
  reduction_holds({&whole}, n, random);
  reduction_holds({&none}, 0, random);
}

void contradictions_are_seen() {
  std::mt19937 random(8);
  const Matrix first(6, random, 1.0), level(5, random, 1.0);
  Matrix against = first;
  against.b[2] += 1e-3;
  ReducedLevel made;
  expect(!reduce_level(n, {first.rows(), against.rows()}, level.rows(), {}, made), "a row cannot have two values");
  for (const bool in_row : {true, false}) {
    Matrix unknown(6, random, 1.0);
    (in_row ? unknown.A[n + 3] : unknown.b[1]) = std::numeric_limits<double>::quiet_NaN();
    expect(!reduce_level(n, {first.rows(), unknown.rows()}, level.rows(), {}, made), "NaN is no value of a row");
  }
}

// What the rows above decide leaves no objective, not one made of rounding errors.
void decided_levels_ask_nothing() {
  std::mt19937 random(9);
  const Matrix first(6, random, 1.0);
  ReducedLevel made;
  expect(reduce_level(n, {first.rows()}, first.rows(), {}, made), "the rows agree");
  for (const double x : made.H) expect(x == 0.0, "no objective");
  for (const double x : made.f) expect(x == 0.0, "no slope");
}

}  // namespace

int main() {
  every_rank_is_handled();
  contradictions_are_seen();
  decided_levels_ask_nothing();
  std::puts("levels in null spaces are those of their definition");
  return 0;
}
