// G1's velocity policies (holosoma): see sumo_dist/policies/g1.py, which states the layout and
// whose `step` this repeats.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "mlp.h"
#include "policy.h"

namespace sumo {

struct G1Layout {
  static constexpr int kJoints = 29;
  static constexpr int kPhases = 4;  // cosines of both phases, then sines

  std::array<double, kJoints> joint_offsets;  // [rad]
  double action_scale, spin_scale, joint_speed_scale;
  std::vector<std::array<float, kPhases>> phases;  // by tick of the gait; the last is of standing
  double stand_below;                              // norm of the commanded velocity
  std::array<double, 3> feedback_gain;
  double feedback_limit;
  double feedback_share;  // of the newest velocity in the filtered one
};

class G1Gait final : public Policy {
 public:
  static constexpr int kObservation = 100;

  G1Gait(Mlp network, const G1Layout& layout);

  PolicySizes sizes() const override;
  std::unique_ptr<Workspace> make_workspace(int rows) const override;
  void step(PolicyRow* rows, int count, Workspace& work) const override;

 private:
  struct Moment;  // what changes before the network is evaluated

  Moment advance(const PolicyRow& row) const;
  void observe(const PolicyRow& row, float* observation) const;
  void act(const PolicyRow& row, const float* action) const;

  Mlp network_;
  G1Layout layout_;
};

}  // namespace sumo
