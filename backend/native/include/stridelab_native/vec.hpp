// Short vectors of doubles: four cones, or eight components of a mixture, at a time.
#pragma once
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

namespace stridelab {

// Extensions of GCC and Clang; on processors without wide registers the compiler splits them.
typedef double v4 __attribute__((vector_size(32)));
typedef double v8 __attribute__((vector_size(64)));
typedef std::int64_t i4 __attribute__((vector_size(32)));
typedef std::int64_t i8 __attribute__((vector_size(64)));

inline v4 splat4(double x) { return v4{x, x, x, x}; }
inline v8 splat8(double x) { return v8{x, x, x, x, x, x, x, x}; }
inline double sum(double a) { return a; }
inline double sum(v4 a) { return (a[0] + a[2]) + (a[1] + a[3]); }
inline double sum(v8 a) { return ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7])); }

inline double root(double a) { return std::sqrt(a); }
inline v4 root(v4 a) {
  v4 r;
  for (int i = 0; i < 4; ++i) r[i] = std::sqrt(a[i]);
  return r;
}

inline std::array<double, 1> parts(double a) { return {a}; }
inline std::array<double, 4> parts(v4 a) { return {a[0], a[1], a[2], a[3]}; }

inline double least(double a) { return a; }
inline double least(v4 a) {
  const double x = a[0] < a[1] ? a[0] : a[1];
  const double y = a[2] < a[3] ? a[2] : a[3];
  return x < y ? x : y;
}

inline double smaller(double a, double b) { return a < b ? a : b; }
inline double larger(double a, double b) { return a > b ? a : b; }
inline v4 smaller(v4 a, v4 b) { return a < b ? a : b; }
inline v4 larger(v4 a, v4 b) { return a > b ? a : b; }

// e^x for x <= 0 within one unit in the last place; below -700 it is that of -700.
//   x = n ln 2 + r, |r| <= ln 2 / 2,   e^x = 2^n (1 + r + r^2/2! + .. + r^13/13!)
inline v8 exponential(v8 x) {
  const v8 low = splat8(-700.0);
  x = x < low ? low : x;
  const v8 magic = splat8(6755399441055744.0);  // 1.5 * 2^52: adding it rounds to an integer
  const v8 shifted = x * splat8(1.4426950408889634) + magic;
  const v8 n = shifted - magic;
  const v8 r = (x - n * splat8(6.93147180369123816490e-01)) - n * splat8(1.90821492927058770002e-10);
  constexpr double inverse_factorials[] = {1.0 / 6227020800.0,
                                           1.0 / 479001600.0,
                                           1.0 / 39916800.0,
                                           1.0 / 3628800.0,
                                           1.0 / 362880.0,
                                           1.0 / 40320.0,
                                           1.0 / 5040.0,
                                           1.0 / 720.0,
                                           1.0 / 120.0,
                                           1.0 / 24.0,
                                           1.0 / 6.0,
                                           0.5,
                                           1.0,
                                           1.0};
  v8 p = splat8(inverse_factorials[0]);
  for (int i = 1; i < 14; ++i) p = p * r + splat8(inverse_factorials[i]);
  const i8 exponent = ((i8)shifted - (i8)magic) << 52;
  return (v8)((i8)p + exponent);
}

}  // namespace stridelab
