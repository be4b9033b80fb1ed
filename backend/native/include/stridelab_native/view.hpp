#pragma once
#include <cstddef>

namespace stridelab {

// A vector or matrix of the caller, with strides in elements.
struct View {
  const double* data = nullptr;
  std::ptrdiff_t row = 0, column = 0;
  double operator()(std::size_t i, std::size_t j = 0) const {
    return data[static_cast<std::ptrdiff_t>(i) * row + static_cast<std::ptrdiff_t>(j) * column];
  }
};

}  // namespace stridelab
