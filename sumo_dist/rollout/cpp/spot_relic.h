// Spot's whole-body policy (Relic): see sumo_dist/policies/spot.py, which states the layout and
// whose `step` this repeats.
#pragma once

#include <array>
#include <memory>

#include "mlp.h"
#include "policy.h"

namespace sumo {

struct SpotLayout {
  static constexpr int kJoints = 19;
  static constexpr int kLegJoints = 12;

  std::array<int, kJoints> joints_to_network;  // network order[i] = model order[...[i]]
  std::array<int, kLegJoints> action_to_legs;  // leg targets[i] = action[...[i]]
  std::array<double, kJoints> joint_offsets;   // model order [rad]
  double action_scale;                         // [rad]
};

class SpotRelic final : public Policy {
 public:
  static constexpr int kObservation = 84;

  SpotRelic(Mlp network, const SpotLayout& layout);

  PolicySizes sizes() const override;
  std::unique_ptr<Workspace> make_workspace(int rows) const override;
  void step(PolicyRow* rows, int count, Workspace& work) const override;

 private:
  void observe(const PolicyRow& row, float* observation) const;
  void act(const PolicyRow& row, const float* action) const;

  Mlp network_;
  SpotLayout layout_;
};

}  // namespace sumo
