// The rotation between two frames, from tiny angles to nearly half a turn.
#include <cmath>
#include <cstdio>

#include "problems.hpp"
#include "stridelab_native/body_rows.hpp"

using namespace stridelab;

namespace {

// Rodrigues' formula.
std::array<double, 9> rotation(const std::array<double, 3>& axis, double angle) {
  std::array<double, 9> R{};
  const double c = std::cos(angle), s = std::sin(angle);
  const double K[3][3] = {{0.0, -axis[2], axis[1]}, {axis[2], 0.0, -axis[0]}, {-axis[1], axis[0], 0.0}};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      R[3 * i + j] = (i == j ? c : 0.0) + s * K[i][j] + (1.0 - c) * axis[i] * axis[j];
    }
  }
  return R;
}

void rotations_are_recovered() {
  const double n = std::sqrt(1.0 + 4.0 + 9.0);
  const std::array<std::array<double, 3>, 5> axes{
      {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, -1.0}, {1.0 / n, -2.0 / n, 3.0 / n}, {-3.0 / n, 2.0 / n, 1.0 / n}}};
  const std::array<double, 9> none = rotation(axes[0], 0.0);
  for (const auto& axis : axes) {
    for (const double angle : {0.0, 1e-12, 1e-8, 1e-3, 0.5, 1.6, 3.0, 3.14159}) {
      const std::array<double, 9> turned = rotation(axis, angle);
      const auto error = rotation_error({turned.data(), 3, 1}, {none.data(), 3, 1});
      const auto back = rotation_error({none.data(), 3, 1}, {turned.data(), 3, 1});
      for (std::size_t i = 0; i < 3; ++i) {
        expect_near(error[i], angle * axis[i], 1e-12, "rotation");
        expect_near(back[i], -angle * axis[i], 1e-12, "rotation back");
      }
    }
  }
}

}  // namespace

int main() {
  rotations_are_recovered();
  std::puts("rotations between frames are recovered");
  return 0;
}
