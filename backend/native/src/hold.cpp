#include "stridelab_native/hold.hpp"

#include <cmath>

namespace stridelab {
namespace {

constexpr int head = nw - 1;

// D^-1/2 g.
void times(const Spectrum& of, const double (&g)[nw], double (&out)[nw]) {
  double along = 0.0;
  for (int i = 0; i < head; ++i) along += of.d[i] * g[i];
  const double plus = of.along * 0.5 * (along + g[head]);
  const double minus = of.against * 0.5 * (along - g[head]);
  for (int i = 0; i < head; ++i) out[i] = of.rest * (g[i] - along * of.d[i]) + (plus + minus) * of.d[i];
  out[head] = plus - minus;
}

}  // namespace

void add_wrench(const WrenchControl& hold, const double (&u)[nw], double* w) {
  for (int i = 0; i < nw; ++i) {
    for (int j = 0; j < nw; ++j) w[i] += hold.cone->G[i][j] * u[j];
  }
}

void pull_wrench(const WrenchControl& hold, const double* y, double (&out)[nw]) {
  for (int j = 0; j < nw; ++j) {
    out[j] = 0.0;
    for (int i = 0; i < nw; ++i) out[j] += hold.cone->G[i][j] * y[i];
  }
}

void scale(WrenchControl& hold, double h) {
  hold.scaling = scaling(hold.at);
  const auto& w = hold.scaling.w;
  const double e = h * hold.cone->effort;
  const double f = hold.scaling.inverse_beta * hold.scaling.inverse_beta;
  const double size = std::sqrt(across(w, w));
  const double stretch = (w[head] + size) * (w[head] + size);  // W^-2 is f / stretch along (d, 1)
  Spectrum& D = hold.D_root;
  for (int i = 0; i < head; ++i) D.d[i] = size > 0.0 ? w[i] / size : (i == 0 ? 1.0 : 0.0);
  D.along = 1.0 / std::sqrt(e + f / stretch);
  D.against = 1.0 / std::sqrt(e + f * stretch);
  D.rest = 1.0 / std::sqrt(e + f);
}

void root_of(const WrenchControl& hold, double L[nw][8]) {
  for (int i = 0; i < nw; ++i) {
    double row[nw];
    times(hold.D_root, hold.cone->G[i], row);
    for (int j = 0; j < nw; ++j) L[i][j] = row[j];
  }
}

void condensed_gradient(const WrenchControl& hold, double h, double tau[nw]) {
  double g[nw];
  double d[nw];
  for (int i = 0; i < nw; ++i) g[i] = h * hold.cone->effort * hold.at.u[i] - hold.target[i];
  times(hold.D_root, g, d);
  for (int i = 0; i < nw; ++i) tau[i] = d[i];
}

void follow(WrenchControl& hold, const double (&omega)[nw]) {
  times(hold.D_root, omega, hold.du);
  double once[nw];
  double twice[nw];
  unscale(hold.scaling, hold.du, once);
  unscale(hold.scaling, once, twice);
  for (int i = 0; i < nw; ++i) hold.dz[i] = hold.target[i] - hold.at.z[i] - twice[i];
}

}  // namespace stridelab
