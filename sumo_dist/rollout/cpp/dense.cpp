// The layers, compiled once per instruction set (see CMakeLists.txt).
//
// A tile of Rows x Panels accumulators stays in registers while the inputs are walked in order, so
// an output is summed the same way in every tile shape and a row never depends on its neighbours.
// Nor does it depend on how many lanes there are: AVX-512 computes the numbers of AVX2.
#include "kernel.h"
#include "simd.h"

namespace {

using sumo::Activation;
using sumo::DenseView;
using sumo::kPanel;
using sumo::NormView;

constexpr float kEpsilon = 1e-5f;  // added to the variance, see sumo_dist/policies/network.py

// Calls `finish` with the activation as a function of lanes.
template <typename Finish>
void with_activation(Activation activation, const Finish& finish) {
  switch (activation) {
    case Activation::kLinear:
      return finish([](Lanes x) { return x; });
    case Activation::kElu:
      return finish([](Lanes x) { return elu(x); });
    case Activation::kSilu:
      return finish([](Lanes x) { return silu(x); });
    case Activation::kTanh:
      return finish([](Lanes x) { return tanh(x); });
  }
}

constexpr int kVectors = kPanel / kLanes;  // vectors per panel and row
#ifdef SUMO_AVX512
// With 32 registers there is room to load an input and a weight once for several additions.
constexpr int kAccumulators = 16, kMaxRows = 8;
#else
constexpr int kAccumulators = 8;  // they hide the latency of their additions
constexpr int kMaxRows = kAccumulators / kVectors;
#endif
constexpr int panels_of(int rows) { return kAccumulators / kVectors / rows; }

template <int Rows, int Panels>
void tile(const DenseView& layer, int panel, const float* x, int x_stride, float* y, int y_stride) {
  const float* bias = layer.bias + panel * kPanel;
  const float* weights = layer.weights + static_cast<long>(panel) * layer.inputs * kPanel;
  const long panel_size = static_cast<long>(layer.inputs) * kPanel;
  Lanes sum[Rows][Panels * kVectors];
#pragma GCC unroll 16
  for (int r = 0; r < Rows; ++r)
#pragma GCC unroll 16
    for (int v = 0; v < Panels * kVectors; ++v) sum[r][v] = load(bias + v * kLanes);

  for (int k = 0; k < layer.inputs; ++k, weights += kPanel) {
    Lanes input[Rows];
#pragma GCC unroll 16
    for (int r = 0; r < Rows; ++r) input[r] = broadcast(x[r * x_stride + k]);
#pragma GCC unroll 16
    for (int v = 0; v < Panels * kVectors; ++v) {
      const Lanes w = load(weights + v / kVectors * panel_size + v % kVectors * kLanes);
#pragma GCC unroll 16
      for (int r = 0; r < Rows; ++r) sum[r][v] = multiply_add(w, input[r], sum[r][v]);
    }
  }

  with_activation(layer.activation, [&](auto activate) {
#pragma GCC unroll 16
    for (int r = 0; r < Rows; ++r)
#pragma GCC unroll 16
      for (int v = 0; v < Panels * kVectors; ++v)
        store(y + r * y_stride + panel * kPanel + v * kLanes, activate(sum[r][v]));
  });
}

// Panels [first, last) of `Rows` rows.
template <int Rows>
void row_tile(const DenseView& layer, int first, int last, const float* x, int x_stride, float* y,
              int y_stride) {
  constexpr int kStep = panels_of(Rows);
  int panel = first;
  for (; panel + kStep <= last; panel += kStep)
    tile<Rows, kStep>(layer, panel, x, x_stride, y, y_stride);
  for (; panel < last; ++panel) tile<Rows, 1>(layer, panel, x, x_stride, y, y_stride);
}

using RowTile = void (*)(const DenseView&, int, int, const float*, int, float*, int);

template <int Rows>
RowTile select_row_tile(int rows) {
  if constexpr (Rows > 1) {
    if (rows < Rows) return select_row_tile<Rows - 1>(rows);
  }
  return row_tile<Rows>;
}

void dense(const DenseView& layer, int rows, const float* x, int x_stride, float* y, int y_stride) {
  const int panels = sumo::padded(layer.outputs) / kPanel;
  const int tiles = (rows + kMaxRows - 1) / kMaxRows;
  const int block = panels_of((rows + tiles - 1) / tiles);  // panels kept in L1 for all tiles
  for (int panel = 0; panel < panels; panel += block) {
    const int last = panel + block < panels ? panel + block : panels;
    for (int t = 0, row = 0; t < tiles; ++t) {
      const int count = (rows - row + tiles - t - 1) / (tiles - t);  // tiles of even height
      select_row_tile<kMaxRows>(count)(layer, panel, last, x + static_cast<long>(row) * x_stride,
                                       x_stride, y + static_cast<long>(row) * y_stride, y_stride);
      row += count;
    }
  }
}

#ifndef SUMO_AVX512  // sums of 16 lanes would be others than those of 8: AVX2's serves both

// The sum of `term` over the outputs: whole vectors first, then what is left one by one.
template <typename Term>
float total(const float* y, int outputs, const Term& term) {
  Lanes vectors{};
  int i = 0;
  for (; i + kLanes <= outputs; i += kLanes) vectors = vectors + term(load(y + i));
  float result = sum(vectors);
  for (; i < outputs; ++i) result += term(broadcast(y[i]))[0];
  return result;
}

void normalise(const NormView& norm, int rows, float* y, int y_stride) {
  with_activation(norm.activation, [&](auto activate) {
    for (int r = 0; r < rows; ++r, y += y_stride) {
      const float count = static_cast<float>(norm.outputs);
      const float mean = total(y, norm.outputs, [](Lanes x) { return x; }) / count;
      const float variance =
          total(y, norm.outputs, [&](Lanes x) { return (x - mean) * (x - mean); }) / count;
      const float deviation = __builtin_sqrtf(variance + kEpsilon);
      for (int i = 0; i < sumo::padded(norm.outputs); i += kLanes) {
        const Lanes unit = (load(y + i) - mean) / deviation;
        store(y + i, activate(multiply_add(unit, load(norm.scale + i), load(norm.shift + i))));
      }
    }
  });
}

#endif

}  // namespace

namespace sumo {

#if defined(SUMO_AVX512)
extern const DenseFunction kAvx512Dense;
const DenseFunction kAvx512Dense = dense;
#elif defined(SUMO_AVX2)
extern const Kernel kAvx2Kernel;
const Kernel kAvx2Kernel{"avx2", "avx2", dense, normalise};
#else
extern const Kernel kPortableKernel;
const Kernel kPortableKernel{"portable", "portable", dense, normalise};
#endif

}  // namespace sumo
