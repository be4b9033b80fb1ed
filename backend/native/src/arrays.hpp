// Views of the arrays that Python passes.
#pragma once
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "stridelab_native/view.hpp"

namespace stridelab {

using Input = nanobind::ndarray<const double, nanobind::device::cpu>;
using Output = nanobind::ndarray<double, nanobind::c_contig, nanobind::device::cpu>;

inline void require(bool holds, const char* what) {
  if (!holds) throw nanobind::value_error(what);
}

// A view of an array of the given shape; ``columns`` 0: a vector. The caller keeps the array.
inline View view(nanobind::handle given, std::size_t rows, std::size_t columns, const char* what) {
  const auto array = nanobind::cast<Input>(given, false);
  const bool is_matrix = columns > 0;
  require(array.ndim() == (is_matrix ? 2u : 1u) && array.shape(0) == rows && (!is_matrix || array.shape(1) == columns),
          what);
  return {array.data(), array.stride(0), is_matrix ? array.stride(1) : 0};
}

}  // namespace stridelab
