// No policy: the command is the joint targets. What remains of a rollout is its physics.
#pragma once

#include <algorithm>
#include <memory>

#include "policy.h"

namespace sumo {

class HoldTargets final : public Policy {
 public:
  explicit HoldTargets(int targets) : targets_(targets) {}

  PolicySizes sizes() const override { return {0, 0, targets_, 0, targets_}; }
  std::unique_ptr<Workspace> make_workspace(int) const override {
    return std::make_unique<Workspace>();
  }
  void step(PolicyRow* rows, int count, Workspace&) const override {
    for (int i = 0; i < count; ++i) std::copy_n(rows[i].command, targets_, rows[i].targets);
  }

 private:
  int targets_;
};

}  // namespace sumo
