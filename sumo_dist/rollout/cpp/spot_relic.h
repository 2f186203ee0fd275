// Spot's whole-body policy (Relic): see sumo_dist/policies/spot.py, whose `step` this repeats, and
// spot_layout.py, where the layout's numbers come from.
#pragma once

#include <limits>
#include <memory>
#include <vector>

#include "mlp.h"
#include "policy.h"

namespace sumo {

struct SpotLayout {
  std::vector<int> joints_to_network;  // network order[i] = model order[...[i]]
  std::vector<int> action_to_legs;     // leg targets[i] = action[...[i]]
  std::vector<double> joint_offsets;   // model order, legs before the arm [rad]
  double action_scale = std::numeric_limits<double>::quiet_NaN();  // [rad]
  int leg_size = 0;                                                // joints
  int command_size = 0;
  int command_arm = -1;  // where the targets of arm and legs begin
  int command_legs = -1;

  int joints() const { return static_cast<int>(joint_offsets.size()); }
  int leg_joints() const { return static_cast<int>(action_to_legs.size()); }
  int arm_joints() const { return joints() - leg_joints(); }
};

class SpotRelic final : public Policy {
 public:
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
