#include "stridelab_native/forces.hpp"

#include "stridelab_native/dense.hpp"

namespace stridelab {
namespace {

// S = sum G D^-1 G^T over the points of an interval, moments about m; lower triangle.
void condense(const Iterate& it, const Stage& s, double S[nw][8]) {
  v4 sums[21] = {};
  for (int b = 0; b < s.contact_blocks; ++b) {
    const ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)];
    const Block& block = *t.block;
    const double* R = block.S;
    const v4* I = t.D_inverse;
    v4 RI[3][3];
    for (int i = 0; i < 3; ++i) {
      RI[i][0] = R[3 * i] * I[0] + R[3 * i + 1] * I[1] + R[3 * i + 2] * I[2];
      RI[i][1] = R[3 * i] * I[1] + R[3 * i + 1] * I[3] + R[3 * i + 2] * I[4];
      RI[i][2] = R[3 * i] * I[2] + R[3 * i + 1] * I[4] + R[3 * i + 2] * I[5];
    }
    v4 M[3][3];  // compliance of a point in world axes
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j <= i; ++j) {
        M[i][j] = (RI[i][0] * R[3 * j] + RI[i][1] * R[3 * j + 1] + RI[i][2] * R[3 * j + 2]) * block.real;
        M[j][i] = M[i][j];
      }
    }
    const v4 p[3] = {block.p[0] - s.m[0], block.p[1] - s.m[1], block.p[2] - s.m[2]};
    v4 C[3][3];  // [p]x M
    for (int j = 0; j < 3; ++j) {
      C[0][j] = p[1] * M[2][j] - p[2] * M[1][j];
      C[1][j] = p[2] * M[0][j] - p[0] * M[2][j];
      C[2][j] = p[0] * M[1][j] - p[1] * M[0][j];
    }
    sums[0] += M[0][0];
    sums[1] += M[1][0];
    sums[2] += M[1][1];
    sums[3] += M[2][0];
    sums[4] += M[2][1];
    sums[5] += M[2][2];
    int at = 6;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) sums[at++] += C[i][j];
      // ([p]x M [p]x^T)_ij = (p x row_i(C))_j
      sums[at++] += p[1] * C[i][2] - p[2] * C[i][1];
      if (i > 0) sums[at++] += p[2] * C[i][0] - p[0] * C[i][2];
      if (i > 1) sums[at++] += p[0] * C[i][1] - p[1] * C[i][0];
    }
  }
  int at = 0;
  for (int i = 0; i < nw; ++i) {
    for (int j = 0; j <= i; ++j) S[i][j] = sum(sums[at++]);
  }
}

// g of a block, without dh Q u.
void slope_of(const Iterate& it, const Stage& s, const ContactBlock& t, v4 g[3]) {
  for (int i = 0; i < 3; ++i) g[i] = s.h * t.effort(i) * t.at.u[i] - t.target[i];
  if (t.load >= 0) g[2] += it.loads[static_cast<std::size_t>(t.load)].pull();
}

template <typename Slope>
double pulled_by(const Iterate& it, const Stage& s, Slope slope, double tau[nw]) {
  v4 sums[nw] = {};
  v4 drag = {};
  for (int b = 0; b < s.contact_blocks; ++b) {
    const ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)];
    const Block& block = *t.block;
    v4 g[3];
    v4 d[3];
    slope(t, g);
    times(t.D_inverse, g, d);
    v4 f[3];
    for (int i = 0; i < 3; ++i) {
      f[i] = (block.S[3 * i] * d[0] + block.S[3 * i + 1] * d[1] + block.S[3 * i + 2] * d[2]) * block.real;
      sums[i] += f[i];
      drag += t.effort(i) * t.at.u[i] * d[i] * block.real;
    }
    sums[3] += block.p[1] * f[2] - block.p[2] * f[1];
    sums[4] += block.p[2] * f[0] - block.p[0] * f[2];
    sums[5] += block.p[0] * f[1] - block.p[1] * f[0];
  }
  for (int i = 0; i < nw; ++i) tau[i] = sum(sums[i]);
  solve_lower(s.L, s.L_inverse, tau);
  return sum(drag);
}

// S^T of the mixed derivative with the forces of a block.
void pull_of(const Block& block, double share, const double pull[3], v4 g[3]) {
  for (int i = 0; i < 3; ++i) {
    g[i] = (block.S[i] * pull[0] + block.S[3 + i] * pull[1] + block.S[6 + i] * pull[2]) * share * block.real;
  }
}

template <typename F>
void each_moved(const Iterate& it, const Stage& s, int place, F f) {
  for (int b = 0; b < s.contact_blocks; ++b) {
    const ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)];
    if (t.block->moved == place) f(t);
  }
}

}  // namespace

void force_of(const Iterate& it, const Stage& s, int place, double F[3]) {
  F[0] = F[1] = F[2] = 0.0;
  each_moved(it, s, place, [&](const ContactBlock& t) {
    const double* S = t.block->S;
    const v4* u = t.at.u;
    for (int i = 0; i < 3; ++i) {
      F[i] += sum((S[3 * i] * u[0] + S[3 * i + 1] * u[1] + S[3 * i + 2] * u[2]) * t.block->real);
    }
  });
}

void condensed_shift_gradient(const Iterate& it, const Stage& s, const ShiftUse& use, Share* shares,
                              double curve[shares_max][shares_max], std::size_t at) {
  const int place = static_cast<int>(use.shift);
  for (std::size_t a = 0; a < 2; ++a) {
    const auto slope = [&](const ContactBlock& t, v4 g[3]) {
      g[0] = g[1] = g[2] = v4{};
      if (t.block->moved == place) pull_of(*t.block, it.pull_share, use.pull[a], g);
    };
    pulled_by(it, s, slope, shares[a].tau);
  }
  each_moved(it, s, place, [&](const ContactBlock& t) {
    v4 g[2][3];
    v4 d[2][3];
    for (std::size_t a = 0; a < 2; ++a) {
      pull_of(*t.block, it.pull_share, use.pull[a], g[a]);
      times(t.D_inverse, g[a], d[a]);
    }
    for (std::size_t a = 0; a < 2; ++a) {
      for (std::size_t b = a; b < 2; ++b) curve[at + a][at + b] -= sum(product(g[a], d[b]));
    }
  });
}

void drag_of_shift(const Iterate& it, const Stage& s, const ShiftUse& use, double drag[2]) {
  drag[0] = drag[1] = 0.0;
  each_moved(it, s, static_cast<int>(use.shift), [&](const ContactBlock& t) {
    v4 g[3];
    v4 d[3];
    slope_of(it, s, t, g);
    times(t.D_inverse, g, d);
    for (std::size_t a = 0; a < 2; ++a) {
      v4 condensed_gradient[3];
      pull_of(*t.block, it.pull_share, use.pull[a], condensed_gradient);
      drag[a] += sum(product(condensed_gradient, d));
    }
  });
}

void scale_forces(Iterate& it, const Stage& s) {
  for (int b = 0; b < s.contact_blocks; ++b) {
    ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)];
    t.scaling = scaling(t.at);
    const v4 along = splat4(s.h * t.block->effort[0]);
    v4 normal = splat4(s.h * t.block->effort[1]);
    if (t.load >= 0) normal += it.loads[static_cast<std::size_t>(t.load)].weight();
    invert(t.scaling, along, normal, t.D_inverse);
  }
}

void root_of_forces(const Iterate& it, Stage& s) {
  double S[nw][8];
  condense(it, s, S);
  semidefinite_root(S, s.L, s.L_inverse);
  // Moments about the origin: T + m x F. The factorisation is about m, as a distant point would hide small pivots.
  for (int j = 0; j < 3; ++j) {
    s.L[3][j] += s.m[1] * s.L[2][j] - s.m[2] * s.L[1][j];
    s.L[4][j] += s.m[2] * s.L[0][j] - s.m[0] * s.L[2][j];
    s.L[5][j] += s.m[0] * s.L[1][j] - s.m[1] * s.L[0][j];
  }
}

double condensed_gradient(const Iterate& it, const Stage& s, double tau[nw]) {
  return pulled_by(it, s, [&](const ContactBlock& t, v4 g[3]) { slope_of(it, s, t, g); }, tau);
}

double condensed_effort_gradient(const Iterate& it, const Stage& s, double tau[nw]) {
  const auto slope = [](const ContactBlock& t, v4 g[3]) {
    for (int i = 0; i < 3; ++i) g[i] = t.effort(i) * t.at.u[i];
  };
  return pulled_by(it, s, slope, tau);
}

void follow(Iterate& it, const Stage& s, double omega[nw], double dh) {
  double* y = omega;
  solve_upper(s.L, s.L_inverse, y);
  for (int b = 0; b < s.contact_blocks; ++b) {
    ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)];
    const Block& block = *t.block;
    const v4 e[3] = {y[0] + y[4] * block.p[2] - y[5] * block.p[1], y[1] + y[5] * block.p[0] - y[3] * block.p[2],
                     y[2] + y[3] * block.p[1] - y[4] * block.p[0]};
    v4 g[3];
    slope_of(it, s, t, g);
    for (int i = 0; i < 3; ++i) {
      g[i] = block.S[i] * e[0] + block.S[3 + i] * e[1] + block.S[6 + i] * e[2] - g[i];
      g[i] -= dh * t.effort(i) * t.at.u[i];
    }
    for (std::size_t m = 0; block.moved >= 0 && m < s.shift_uses; ++m) {
      const ShiftUse& use = it.shift_uses[s.first_shift_use + m];
      if (use.shift != static_cast<std::size_t>(block.moved)) continue;
      for (std::size_t a = 0; a < 2; ++a) {
        v4 condensed_gradient[3];
        pull_of(block, it.pull_share, use.pull[a], condensed_gradient);
        for (int i = 0; i < 3; ++i) g[i] -= it.shifts[use.shift].step[a] * condensed_gradient[i];
      }
    }
    times(t.D_inverse, g, t.du);
    if (t.load >= 0) it.loads[static_cast<std::size_t>(t.load)].follow(t.du[2]);
    v4 E[6];
    inverse_square(t.scaling, E);
    times(E, t.du, t.dz);
    for (int i = 0; i < 3; ++i) t.dz[i] = t.target[i] - t.at.z[i] - t.dz[i];
  }
}

void follow_slope(Iterate& it, const Stage& s, const double y[nw]) {
  for (int b = 0; b < s.contact_blocks; ++b) {
    ContactBlock& t = it.contact_blocks[static_cast<std::size_t>(s.first_contact_block + b)];
    const Block& block = *t.block;
    const v4 e[3] = {y[0] + y[4] * block.p[2] - y[5] * block.p[1], y[1] + y[5] * block.p[0] - y[3] * block.p[2],
                     y[2] + y[3] * block.p[1] - y[4] * block.p[0]};
    for (int i = 0; i < 3; ++i) {
      t.dz[i] = block.S[i] * e[0] + block.S[3 + i] * e[1] + block.S[6 + i] * e[2];
      t.dz[i] += s.h * t.effort(i) * (t.at.u[i] + t.du[i]) - t.at.z[i];
    }
    if (t.load < 0) continue;
    const Slack<v4>& load = it.loads[static_cast<std::size_t>(t.load)];
    t.dz[2] += load.zeta + load.dzeta;
  }
}

}  // namespace stridelab
