// Vector lanes of one kernel variant. Included once per variant by dense.cpp; everything is in an
// unnamed namespace so that the linker never shares code between instruction sets.
#pragma once

#include <cstdint>
#include <cstring>

#ifdef SUMO_AVX2
#include <immintrin.h>
#endif

namespace {

#ifdef SUMO_AVX2
constexpr int kLanes = 8;
#else
constexpr int kLanes = 4;
#endif

typedef float Lanes __attribute__((vector_size(kLanes * sizeof(float))));
typedef std::int32_t IntLanes __attribute__((vector_size(kLanes * sizeof(float))));

inline Lanes load(const float* p) {
  Lanes v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

inline void store(float* p, Lanes v) { std::memcpy(p, &v, sizeof v); }

inline Lanes broadcast(float x) { return Lanes{} + x; }

// a * b + c: fused with AVX2, rounded twice in the portable variant (on every platform alike).
inline Lanes multiply_add(Lanes a, Lanes b, Lanes c) {
#ifdef SUMO_AVX2
  return _mm256_fmadd_ps(a, b, c);
#else
  return a * b + c;
#endif
}

// exp(x) - 1 for x in [-87, 0]. With n = round(x / ln 2) and r = x - n ln 2 the result is
// 2^n (e^r - 1) + (2^n - 1), exact to 2 ulp near zero; the absolute error is below 1.2e-7.
inline Lanes expm1_negative(Lanes x) {
  constexpr float kLog2E = 1.44269504f;
  constexpr float kLn2High = 0.693359375f, kLn2Low = -2.12194440e-4f;  // ln 2 in two parts
  constexpr float kRound = 12582912.0f;  // 1.5 * 2^23: adding it rounds to an integer
  const Lanes shifted = multiply_add(x, broadcast(kLog2E), broadcast(kRound));
  const Lanes n = shifted - kRound;
  Lanes r = multiply_add(n, broadcast(-kLn2High), x);
  r = multiply_add(n, broadcast(-kLn2Low), r);
  // Minimax polynomial of (e^r - 1 - r) / r^2 on [-ln 2 / 2, ln 2 / 2] (Cephes expf).
  Lanes p = broadcast(1.9875691500e-4f);
  p = multiply_add(p, r, broadcast(1.3981999507e-3f));
  p = multiply_add(p, r, broadcast(8.3334519073e-3f));
  p = multiply_add(p, r, broadcast(4.1665795894e-2f));
  p = multiply_add(p, r, broadcast(1.6666665459e-1f));
  p = multiply_add(p, r, broadcast(5.0000001201e-1f));
  p = multiply_add(p * r, r, r);
  IntLanes bits;
  std::memcpy(&bits, &shifted, sizeof bits);
  bits = (bits << 23) + 0x3f800000;  // the integer n sits in the low bits of `shifted`
  Lanes power;
  std::memcpy(&power, &bits, sizeof power);
  return multiply_add(power, p, power - 1.0f);
}

inline Lanes elu(Lanes x) {
  const Lanes floor = broadcast(-87.0f);
  const Lanes clamped = x < floor ? floor : (x > Lanes{} ? Lanes{} : x);
  return x <= Lanes{} ? expm1_negative(clamped) : x;  // NaN passes through
}

}  // namespace
