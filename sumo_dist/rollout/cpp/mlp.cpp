#include "mlp.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace sumo {
namespace {

Buffer pack(const Dense& layer) {
  Buffer packed(static_cast<std::size_t>(padded(layer.outputs)) * layer.inputs);
  for (int o = 0; o < layer.outputs; ++o) {
    float* panel = packed.data() + static_cast<long>(o / kPanel) * layer.inputs * kPanel;
    const float* row = layer.weights + static_cast<long>(o) * layer.inputs;
    for (int k = 0; k < layer.inputs; ++k) panel[k * kPanel + o % kPanel] = row[k];
  }
  return packed;
}

// One number an output, followed by zeros; zeros alone if there are none.
Buffer pad(const float* numbers, int outputs) {
  Buffer result(padded(outputs));
  if (numbers != nullptr) std::copy_n(numbers, outputs, result.data());
  return result;
}

void amplify(const float* gain, int outputs, int rows, float* y, int stride) {
  for (int r = 0; r < rows; ++r, y += stride)
    for (int o = 0; o < outputs; ++o) y[o] *= gain[o];
}

}  // namespace

Mlp::Workspace::Workspace(int rows, int stride)
    : stride_(stride),
      front_(static_cast<std::size_t>(rows) * stride),
      back_(static_cast<std::size_t>(rows) * stride) {}

Mlp::Mlp(const Kernel& kernel, const std::vector<Dense>& layers) : kernel_(kernel) {
  if (layers.empty()) throw std::invalid_argument("a network without layers");
  for (const Dense& layer : layers) {
    if (!layers_.empty() && layers_.back().outputs != layer.inputs)
      throw std::invalid_argument("network layers do not fit together");
    const int outputs = layer.outputs;
    layers_.push_back({layer.inputs, outputs, pack(layer), pad(layer.bias, outputs),
                       layer.activation, layer.scale != nullptr, layer.gain != nullptr,
                       pad(layer.scale, outputs), pad(layer.shift, outputs),
                       pad(layer.gain, outputs)});
    width_ = std::max({width_, padded(layer.inputs), padded(layer.outputs)});
  }
}

void Mlp::forward(int rows, Workspace& work) const {
  for (const Packed& layer : layers_) {
    const DenseView view{layer.inputs, layer.outputs, layer.weights.data(), layer.bias.data(),
                         layer.normalised ? Activation::kLinear : layer.activation};
    float* y = work.back_.data();
    kernel_.dense(view, rows, work.front_.data(), work.stride_, y, work.stride_);
    if (layer.normalised) {
      const NormView norm{layer.outputs, layer.scale.data(), layer.shift.data(), layer.activation};
      kernel_.normalise(norm, rows, y, work.stride_);
    }
    if (layer.amplified) amplify(layer.gain.data(), layer.outputs, rows, y, work.stride_);
    std::swap(work.front_, work.back_);
  }
  work.output_ = work.front_.data();
}

}  // namespace sumo
