// The dense layer, compiled once per instruction set (see CMakeLists.txt).
//
// A tile of Rows x Panels accumulators stays in registers while the inputs are walked in order, so
// an output is summed the same way in every tile shape and a row never depends on its neighbours.
#include "kernel.h"
#include "simd.h"

namespace {

using sumo::Activation;
using sumo::DenseView;
using sumo::kPanel;

constexpr int kVectors = kPanel / kLanes;  // vectors per panel and row
constexpr int kMaxRows = 8 / kVectors;     // 8 accumulators hide the latency of their additions
constexpr int panels_of(int rows) { return kMaxRows / rows; }

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

#pragma GCC unroll 16
  for (int r = 0; r < Rows; ++r)
#pragma GCC unroll 16
    for (int v = 0; v < Panels * kVectors; ++v) {
      const Lanes s = layer.activation == Activation::kElu ? elu(sum[r][v]) : sum[r][v];
      store(y + r * y_stride + panel * kPanel + v * kLanes, s);
    }
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

}  // namespace

namespace sumo {

#ifdef SUMO_AVX2
extern const Kernel kAvx2Kernel;
const Kernel kAvx2Kernel{"avx2", dense};
#else
extern const Kernel kPortableKernel;
const Kernel kPortableKernel{"portable", dense};
#endif

}  // namespace sumo
