// Vector lanes of one kernel variant. Included once per variant by dense.cpp; everything is in an
// unnamed namespace so that the linker never shares code between instruction sets.
#pragma once

#include <cstdint>
#include <cstring>

#if defined(SUMO_AVX2) || defined(SUMO_AVX512)
#include <immintrin.h>
#endif

namespace {

#if defined(SUMO_AVX512)
constexpr int kLanes = 16;
#elif defined(SUMO_AVX2)
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

// a * b + c: fused with AVX, rounded twice in the portable variant (on every platform alike).
inline Lanes multiply_add(Lanes a, Lanes b, Lanes c) {
#if defined(SUMO_AVX512)
  return _mm512_fmadd_ps(a, b, c);
#elif defined(SUMO_AVX2)
  return _mm256_fmadd_ps(a, b, c);
#else
  return a * b + c;
#endif
}

inline Lanes min(Lanes a, Lanes b) { return a < b ? a : b; }
inline Lanes magnitude(Lanes x) { return x < Lanes{} ? -x : x; }

// e^x = power * (1 + rest) for x in [-87, 0]: with n = round(x / ln 2), power = 2^n and
// rest = e^(x - n ln 2) - 1, which is exact to 1 ulp.
struct Exponential {
  Lanes power, rest;
};

inline Exponential exponential(Lanes x) {
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
  return {power, p};
}

// exp(x) - 1 for x in [-87, 0], exact to 2 ulp near zero; the absolute error is below 1.2e-7.
inline Lanes expm1_negative(Lanes x) {
  const Exponential e = exponential(x);
  return multiply_add(e.power, e.rest, e.power - 1.0f);
}

// exp(x) for x in [-87, 0], to 2 ulp.
inline Lanes exp_negative(Lanes x) {
  const Exponential e = exponential(x);
  return multiply_add(e.power, e.rest, e.power);
}

inline Lanes elu(Lanes x) {
  const Lanes floor = broadcast(-87.0f);
  const Lanes clamped = x < floor ? floor : (x > Lanes{} ? Lanes{} : x);
  return x <= Lanes{} ? expm1_negative(clamped) : x;  // NaN passes through
}

// x / (1 + e^-x); with e = e^-|x| the denominator never overflows.
inline Lanes silu(Lanes x) {
  const Lanes e = exp_negative(-min(magnitude(x), broadcast(87.0f)));
  return x * ((x < Lanes{} ? e : broadcast(1.0f)) / (1.0f + e));  // NaN passes through
}

// (1 - e^-2|x|) / (1 + e^-2|x|) with the sign of x.
inline Lanes tanh(Lanes x) {
  const Lanes less = expm1_negative(-2.0f * min(magnitude(x), broadcast(43.0f)));
  const Lanes size = -less / (less + 2.0f);
  return x == x ? (x < Lanes{} ? -size : size) : x;  // NaN passes through
}

// The lanes' sum, paired in a fixed order.
inline float sum(Lanes x) {
  float lane[kLanes];
  store(lane, x);
  for (int width = kLanes / 2; width > 0; width /= 2)
    for (int i = 0; i < width; ++i) lane[i] += lane[i + width];
  return lane[0];
}

}  // namespace
