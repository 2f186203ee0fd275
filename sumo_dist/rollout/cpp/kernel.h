// One layer, y = activation(norm(W x + b)), as a table of kernels for the running CPU.
#pragma once

namespace sumo {

enum class Activation { kLinear, kElu, kSilu, kTanh };

// Outputs are packed in panels: weights[panel][input][kPanel], padded with zeros.
constexpr int kPanel = 16;

constexpr int padded(int n) { return (n + kPanel - 1) / kPanel * kPanel; }

struct DenseView {
  int inputs;
  int outputs;
  const float* weights;  // padded(outputs) / kPanel panels of inputs x kPanel
  const float* bias;     // padded(outputs)
  Activation activation;
};

// x: rows x x_stride, y: rows x y_stride with y_stride >= padded(outputs); both 64-byte aligned.
// Every output is bias + w_0 x_0 + w_1 x_1 + ... summed in this order, whatever `rows` is.
using DenseFunction = void (*)(const DenseView& layer, int rows, const float* x, int x_stride,
                               float* y, int y_stride);

struct NormView {
  int outputs;
  const float* scale;  // padded(outputs), zeros behind the outputs
  const float* shift;  // likewise
  Activation activation;
};

// Layer normalisation of each row of y in place, then the activation. A row's mean and variance
// are summed in the same order, whatever `rows` is.
using NormFunction = void (*)(const NormView& norm, int rows, float* y, int y_stride);

struct Kernel {
  const char* name;  // of the instructions
  const char* bits;  // kernels with the same word here compute the same bits
  DenseFunction dense;
  NormFunction normalise;
};

}  // namespace sumo
