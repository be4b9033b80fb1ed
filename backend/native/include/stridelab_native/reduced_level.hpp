// A level of least squares in the null space of the rows above it; formulas as in wholebody/control/hierarchical_qp.py.
#pragma once
#include <cstddef>
#include <vector>

#include "stridelab_native/view.hpp"

namespace stridelab {

// Rows ``A z = b``; in a level they are met as well as possible.
struct LinearRows {
  View A, b;
  std::size_t m = 0;
};

// ``lower <= G z <= upper``.
struct BoundRows {
  View G, lower, upper;
  std::size_t m = 0;
};

// With ``z + Z w`` for the unknowns, Z an orthonormal basis of the null space of the rows above, ``n x k``:
//   min_w  w' H w / 2 + f' w ,   lower <= C w <= upper .
// Matrices are stored row by row.
struct ReducedLevel {
  std::size_t n = 0, k = 0;
  std::vector<double> z, Z, H, f, C, lower, upper;
};

// Fills ``made``; false if the rows of one of the blocks ``above`` contradict those of others, or are not finite.
bool reduce_level(std::size_t n, const std::vector<LinearRows>& above, const LinearRows& level, const BoundRows& bounds,
                  ReducedLevel& made);

}  // namespace stridelab
