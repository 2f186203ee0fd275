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

Buffer pad(const Dense& layer) {
  Buffer bias(padded(layer.outputs));
  std::copy_n(layer.bias, layer.outputs, bias.data());
  return bias;
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
    layers_.push_back({layer.inputs, layer.outputs, pack(layer), pad(layer), layer.activation});
    width_ = std::max({width_, padded(layer.inputs), padded(layer.outputs)});
  }
}

void Mlp::forward(int rows, Workspace& work) const {
  for (const Packed& layer : layers_) {
    const DenseView view{layer.inputs, layer.outputs, layer.weights.data(), layer.bias.data(),
                         layer.activation};
    kernel_.dense(view, rows, work.front_.data(), work.stride_, work.back_.data(), work.stride_);
    std::swap(work.front_, work.back_);
  }
  work.output_ = work.front_.data();
}

}  // namespace sumo
