// A multilayer perceptron in float32, its weights packed once for the kernel.
#pragma once

#include <memory>
#include <vector>

#include "buffer.h"
#include "kernel.h"

namespace sumo {

// One layer as it comes from the weight file: weights row-major, outputs x inputs.
struct Dense {
  int inputs;
  int outputs;
  const float* weights;
  const float* bias;
  Activation activation;
  // Each of `outputs`, or null: scale and shift of a layer normalisation, gain of the activation.
  const float* scale;
  const float* shift;
  const float* gain;
};

class Mlp {
 public:
  Mlp(const Kernel& kernel, const std::vector<Dense>& layers);

  // Activations of up to `rows` rows; each thread owns one.
  class Workspace {
   public:
    float* input(int row) { return front_.data() + static_cast<long>(row) * stride_; }
    const float* output(int row) const { return output_ + static_cast<long>(row) * stride_; }

   private:
    friend class Mlp;
    Workspace(int rows, int stride);

    int stride_;
    Buffer front_, back_;
    const float* output_ = nullptr;
  };

  Workspace make_workspace(int rows) const { return Workspace(rows, width_); }

  // Evaluates the first `rows` inputs of the workspace, which it overwrites.
  void forward(int rows, Workspace& work) const;

  int inputs() const { return layers_.front().inputs; }
  int outputs() const { return layers_.back().outputs; }

 private:
  struct Packed {
    int inputs, outputs;
    Buffer weights, bias;
    Activation activation;
    bool normalised, amplified;
    Buffer scale, shift, gain;
  };

  const Kernel& kernel_;
  std::vector<Packed> layers_;
  int width_ = 0;  // of the widest layer, padded
};

}  // namespace sumo
