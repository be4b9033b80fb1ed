#include "stridelab_native/reduced_level.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "stridelab_native/vec.hpp"

namespace stridelab {

namespace {

// Pivots below this share of the largest one count as zero.
constexpr double rank_share = 1e-9;
// Largest residual, relative to the right-hand side, of rows that do not contradict each other.
constexpr double consistent = 1e-7;
// Largest entry, relative to the level's rows, of a level that the rows above leave nothing to decide.
constexpr double rounding = 1e-10;
constexpr double no_bound = 1e30;

double dot(const double* a, const double* b, std::size_t n) {
  v4 sums[2] = {splat4(0.0), splat4(0.0)};
  std::size_t i = 0;
  for (; i + 8 <= n; i += 8) {
    v4 x[2], y[2];
    std::memcpy(x, a + i, sizeof x);
    std::memcpy(y, b + i, sizeof y);
    sums[0] += x[0] * y[0];
    sums[1] += x[1] * y[1];
  }
  double rest = 0.0;
  for (; i < n; ++i) rest += a[i] * b[i];
  return sum(sums[0] + sums[1]) + rest;
}

// y += c x
void add_multiple(double* y, double c, const double* x, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) y[i] += c * x[i];
}

// ``A' P = Q R`` by Householder reflections ``1 - tau v v'`` with column pivoting. Row j of ``factors`` is column
// order[j] of A': above j the entries of R, from j on v, whose first entry is 1; ``pivots`` is the diagonal of R.
struct Factorisation {
  std::size_t n, rank = 0;
  std::vector<double> factors, pivots, tau;
  std::vector<std::size_t> order;

  double* column(std::size_t j) { return factors.data() + order[j] * n; }
};

void swap_in_largest(Factorisation& qr, std::vector<double>& norms, std::size_t j) {
  std::size_t best = j;
  for (std::size_t c = j + 1; c < qr.order.size(); ++c) {
    if (norms[qr.order[c]] > norms[qr.order[best]]) best = c;
  }
  std::swap(qr.order[j], qr.order[best]);
}

void factorise(Factorisation& qr) {
  const std::size_t n = qr.n, m = qr.order.size(), most = std::min(m, n);
  qr.pivots.assign(most, 0.0);
  qr.tau.assign(most, 0.0);
  std::vector<double> norms(m), exact(m);  // squares of what is left of each column, downdated and last computed
  for (std::size_t c = 0; c < m; ++c) {
    const double* const x = qr.factors.data() + c * n;
    norms[c] = exact[c] = dot(x, x, n);
  }
  for (std::size_t j = 0; j < most; ++j) {
    swap_in_largest(qr, norms, j);
    double* const v = qr.column(j) + j;
    const std::size_t length = n - j;
    const double tail = dot(v + 1, v + 1, length - 1);
    const double size = std::sqrt(v[0] * v[0] + tail), pivot = tail > 0.0 ? -std::copysign(size, v[0]) : v[0];
    if (!(std::fabs(pivot) > rank_share * std::fabs(j == 0 ? pivot : qr.pivots[0]))) return;
    if (tail > 0.0) {
      qr.tau[j] = (pivot - v[0]) / pivot;
      const double scale = 1.0 / (v[0] - pivot);
      for (std::size_t i = 1; i < length; ++i) v[i] *= scale;
    }
    v[0] = 1.0;
    qr.pivots[j] = pivot;
    qr.rank = j + 1;
    for (std::size_t c = j + 1; c < m; ++c) {
      double* const x = qr.column(c) + j;
      if (qr.tau[j] != 0.0) add_multiple(x, -qr.tau[j] * dot(v, x, length), v, length);
      double& norm = norms[qr.order[c]];
      norm -= x[0] * x[0];
      if (!(norm > 1e-8 * exact[qr.order[c]])) norm = exact[qr.order[c]] = dot(x + 1, x + 1, length - 1);
    }
  }
}

// Smallest solution of ``R' y = P' b``, ``z = Q y``.
void smallest_solution(Factorisation& qr, const std::vector<double>& b, std::vector<double>& z) {
  z.assign(qr.n, 0.0);
  for (std::size_t j = 0; j < qr.rank; ++j) z[j] = (b[qr.order[j]] - dot(qr.column(j), z.data(), j)) / qr.pivots[j];
  for (std::size_t j = qr.rank; j-- > 0;) {
    const double* const v = qr.column(j) + j;
    add_multiple(z.data() + j, -qr.tau[j] * dot(v, z.data() + j, qr.n - j), v, qr.n - j);
  }
}

// The last n - rank columns of Q.
void null_space(Factorisation& qr, std::vector<double>& Z) {
  const std::size_t n = qr.n, k = n - qr.rank;
  Z.assign(n * k, 0.0);
  for (std::size_t i = 0; i < k; ++i) Z[(qr.rank + i) * k + i] = 1.0;
  std::vector<double> w(k);
  for (std::size_t j = qr.rank; j-- > 0;) {
    const double* const v = qr.column(j) + j;
    std::fill(w.begin(), w.end(), 0.0);
    for (std::size_t i = j + 1; i < n; ++i) add_multiple(w.data(), v[i - j], Z.data() + i * k, k);
    for (std::size_t i = j; i < n; ++i) add_multiple(Z.data() + i * k, -qr.tau[j] * v[i - j], w.data(), k);
  }
}

void copy_row(const View& rows, std::size_t i, std::vector<double>& row) {
  if (rows.column == 1) {
    const double* const first = rows.data + static_cast<std::ptrdiff_t>(i) * rows.row;
    std::copy(first, first + row.size(), row.begin());
    return;
  }
  for (std::size_t j = 0; j < row.size(); ++j) row[j] = rows(i, j);
}

// ``rows Z`` row by row, and ``rows z``; most entries of the rows are zero.
void multiply_sparse(const View& rows, std::size_t m, const ReducedLevel& made, std::vector<double>& product,
                     std::vector<double>& at) {
  const std::size_t k = made.k;
  product.assign(m * k, 0.0);
  at.assign(m, 0.0);
  std::vector<double> row(made.n);
  for (std::size_t i = 0; i < m; ++i) {
    copy_row(rows, i, row);
    for (std::size_t j = 0; j < made.n; ++j) {
      const double entry = row[j];
      if (entry == 0.0) continue;
      at[i] += entry * made.z[j];
      add_multiple(product.data() + i * k, entry, made.Z.data() + j * k, k);
    }
  }
}

double largest(const std::vector<double>& values) {
  v4 most = splat4(0.0);
  std::size_t i = 0;
  for (; i + 4 <= values.size(); i += 4) {
    v4 x;
    std::memcpy(&x, values.data() + i, sizeof x);
    most = larger(larger(x, -x), most);
  }
  double whole = std::max(std::max(most[0], most[1]), std::max(most[2], most[3]));
  for (; i < values.size(); ++i) whole = std::max(whole, std::fabs(values[i]));
  return whole;
}

// H = B' B and f = B' (A z - b); four rows at a time.
void fill_objective(const LinearRows& level, ReducedLevel& made) {
  const std::size_t k = made.k, m = level.m;
  std::vector<double> B, off;
  multiply_sparse(level.A, m, made, B, off);
  double most = 0.0;
  std::vector<double> row(made.n);
  for (std::size_t i = 0; i < m; ++i) {
    off[i] -= level.b(i);
    copy_row(level.A, i, row);
    most = std::max(most, largest(row));
  }
  made.H.assign(k * k, 0.0);
  made.f.assign(k, 0.0);
  if (largest(B) <= rounding * most) return;  // decided above; rounding errors would drive w until the bounds stop it
  const std::size_t padded = (m + 3) / 4 * 4;
  B.resize(padded * k, 0.0);
  for (std::size_t r = 0; r < padded; r += 4) {
    const double *const b0 = B.data() + r * k, *const b1 = b0 + k, *const b2 = b1 + k, *const b3 = b2 + k;
    for (std::size_t i = 0; i < k; ++i) {
      double* const h = made.H.data() + i * k;
      const double c0 = b0[i], c1 = b1[i], c2 = b2[i], c3 = b3[i];
      for (std::size_t j = i; j < k; ++j) h[j] += (c0 * b0[j] + c1 * b1[j]) + (c2 * b2[j] + c3 * b3[j]);
    }
  }
  for (std::size_t i = 0; i < k; ++i) {
    for (std::size_t j = 0; j < i; ++j) made.H[i * k + j] = made.H[j * k + i];
  }
  for (std::size_t r = 0; r < m; ++r) add_multiple(made.f.data(), off[r], B.data() + r * k, k);
}

// Whether each block is met up to rounding, relative to its own right-hand side; NaN is not.
bool are_met(const std::vector<LinearRows>& above, const std::vector<double>& z) {
  for (const LinearRows& block : above) {
    double size = 0.0;
    for (std::size_t i = 0; i < block.m; ++i) size = std::max(size, std::fabs(block.b(i)));
    for (std::size_t i = 0; i < block.m; ++i) {
      double off = -block.b(i);
      for (std::size_t j = 0; j < z.size(); ++j) off += block.A(i, j) * z[j];
      if (!(std::fabs(off) <= consistent * (1.0 + size))) return false;
    }
  }
  return true;
}

}  // namespace

bool reduce_level(std::size_t n, const std::vector<LinearRows>& above, const LinearRows& level, const BoundRows& bounds,
                  ReducedLevel& made) {
  std::size_t m = 0;
  for (const LinearRows& block : above) m += block.m;
  Factorisation qr{n, 0, std::vector<double>(m * n), {}, {}, std::vector<std::size_t>(m)};
  std::iota(qr.order.begin(), qr.order.end(), std::size_t{0});
  std::vector<double> b(m);
  std::size_t row = 0;
  for (const LinearRows& block : above) {
    for (std::size_t i = 0; i < block.m; ++i, ++row) {
      b[row] = block.b(i);
      for (std::size_t j = 0; j < n; ++j) qr.factors[row * n + j] = block.A(i, j);
    }
  }
  factorise(qr);
  smallest_solution(qr, b, made.z);
  const bool is_finite = std::all_of(made.z.begin(), made.z.end(), [](double x) { return std::isfinite(x); });
  if (!is_finite || (qr.rank < m && !are_met(above, made.z))) return false;
  made.n = n;
  made.k = n - qr.rank;
  null_space(qr, made.Z);
  fill_objective(level, made);
  std::vector<double> off;
  multiply_sparse(bounds.G, bounds.m, made, made.C, off);
  made.lower.resize(bounds.m);
  made.upper.resize(bounds.m);
  for (std::size_t i = 0; i < bounds.m; ++i) {
    made.lower[i] = std::max(bounds.lower(i) - off[i], -no_bound);
    made.upper[i] = std::min(bounds.upper(i) - off[i], no_bound);
  }
  return true;
}

}  // namespace stridelab
