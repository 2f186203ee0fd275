// G1's velocity policies (holosoma): see sumo_dist/policies/g1.py, whose `step` this repeats, and
// g1_layout.py, where the layout's numbers come from.
#pragma once

#include <array>
#include <limits>
#include <memory>
#include <vector>

#include "mlp.h"
#include "policy.h"

namespace sumo {

struct G1Layout {
  static constexpr int kPhases = 4;  // cosines of both phases, then sines
  static constexpr double kUnset = std::numeric_limits<double>::quiet_NaN();

  std::vector<double> joint_offsets;  // [rad]
  double action_scale = kUnset, spin_scale = kUnset, joint_speed_scale = kUnset;
  std::vector<std::array<float, kPhases>> phases;  // by tick of the gait; the last is of standing
  float standing = -1.0f;                          // in place of that tick
  double stand_below = kUnset;                     // norm of the commanded velocity
  std::array<double, 3> feedback_gain{kUnset, kUnset, kUnset};
  double feedback_limit = kUnset;
  double feedback_share = kUnset;    // of the newest velocity in the filtered one
  int first_arm = -1, arm_size = 0;  // the arms are the last joints
  int command_size = 0;
  int command_arms = -1;     // where the arms' targets begin
  int command_follows = -1;  // for each arm whether it follows them
  int memory_size = 0;       // the last action comes first
  int memory_gait = -1, memory_velocity = -1;

  int joints() const { return static_cast<int>(joint_offsets.size()); }
};

class G1Gait final : public Policy {
 public:
  G1Gait(Mlp network, const G1Layout& layout);

  PolicySizes sizes() const override;
  std::unique_ptr<Workspace> make_workspace(int rows) const override;
  void step(PolicyRow* rows, int count, Workspace& work) const override;

 private:
  struct Moment;  // what changes before the network is evaluated

  bool commanded(const PolicyRow& row, int joint) const;
  Moment advance(const PolicyRow& row) const;
  void observe(const PolicyRow& row, float* observation) const;
  void act(const PolicyRow& row, const float* action) const;

  Mlp network_;
  G1Layout layout_;
  std::vector<int> follows_;  // by joint: where the command says that it is followed, or -1
};

}  // namespace sumo
