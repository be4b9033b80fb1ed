// What holds after a full step of Newton's method, whatever the forces are between nodes.
#pragma once

#include <cstddef>
#include <vector>

#include "problems.hpp"
#include "stridelab_native/solver.hpp"

namespace stridelab {

// The wrenches of all nodes as they are to be once the step is taken.
inline std::vector<double> wrenches_ahead(const Iterate& it) {
  std::vector<double> wrenches;
  for (const Stage& s : it.stages) {
    for (int i = 0; i < nw; ++i) wrenches.push_back(s.w[i] + s.dw[i]);
  }
  return wrenches;
}

// The linear equations hold: the gaps are closed, and the forces make the wrenches that were ahead.
inline void expect_taken(const Iterate& it, const std::vector<double>& wrenches) {
  for (std::size_t k = 0; k + 1 < it.stages.size(); ++k) {
    for (int i = 0; i < nx; ++i) expect_near(it.stages[k].gap[i], 0.0, 1e-9, "gap after a full step");
    for (int i = 0; i < nw; ++i) {
      expect_near(it.stages[k].w[i], wrenches[k * nw + static_cast<std::size_t>(i)], 1e-8, "wrench");
    }
  }
}

}  // namespace stridelab
