#include "spot_relic.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "rotation.h"

namespace sumo {
namespace {

// The command, and where its parts start.
constexpr int kCommand = 25;
constexpr int kCommandArm = 3;
constexpr int kCommandLegs = 10;

constexpr int kJoints = SpotLayout::kJoints;
constexpr int kLegJoints = SpotLayout::kLegJoints;

struct Work final : Policy::Workspace {
  explicit Work(Mlp::Workspace network) : network(std::move(network)) {}
  Mlp::Workspace network;
};

}  // namespace

SpotRelic::SpotRelic(Mlp network, const SpotLayout& layout)
    : network_(std::move(network)), layout_(layout) {
  if (network_.inputs() != kObservation || network_.outputs() != kLegJoints)
    throw std::invalid_argument("spot_relic needs a network of 84 inputs and 12 outputs");
  const auto outside = [](int n) { return [n](int i) { return i < 0 || i >= n; }; };
  const auto& joints = layout_.joints_to_network;
  const auto& legs = layout_.action_to_legs;
  if (std::any_of(joints.begin(), joints.end(), outside(kJoints)) ||
      std::any_of(legs.begin(), legs.end(), outside(kLegJoints)))
    throw std::invalid_argument("spot_relic: joint index out of range");
}

PolicySizes SpotRelic::sizes() const {
  return {7 + kJoints, 6 + kJoints, kCommand, kLegJoints, kJoints};
}

std::unique_ptr<Policy::Workspace> SpotRelic::make_workspace(int rows) const {
  return std::make_unique<Work>(network_.make_workspace(rows));
}

void SpotRelic::step(PolicyRow* rows, int count, Workspace& work) const {
  Mlp::Workspace& network = static_cast<Work&>(work).network;
  for (int i = 0; i < count; ++i) observe(rows[i], network.input(i));
  network_.forward(count, network);
  for (int i = 0; i < count; ++i) act(rows[i], network.output(i));
}

void SpotRelic::observe(const PolicyRow& row, float* out) const {
  const Rotation base = rotation(row.qpos + 3);
  for (int i = 0; i < 3; ++i)  // base velocity, world to base frame
    *out++ = static_cast<float>(base.into_base(row.qvel, i));
  for (int i = 3; i < 6; ++i) *out++ = static_cast<float>(row.qvel[i]);
  for (int i = 0; i < 3; ++i) *out++ = static_cast<float>(-base.row[2][i]);  // gravity
  for (int i = 0; i < kCommand; ++i) *out++ = static_cast<float>(row.command[i]);
  for (const int joint : layout_.joints_to_network)
    *out++ = static_cast<float>(row.qpos[7 + joint] - layout_.joint_offsets[joint]);
  for (const int joint : layout_.joints_to_network)
    *out++ = static_cast<float>(row.qvel[6 + joint]);
  std::copy_n(row.memory, kLegJoints, out);
}

void SpotRelic::act(const PolicyRow& row, const float* action) const {
  for (int leg = 0; leg < kLegJoints; leg += 3) {
    const double* command = row.command + kCommandLegs + leg;
    const bool commanded = command[0] != 0.0 || command[1] != 0.0 || command[2] != 0.0;
    for (int i = leg; i < leg + 3; ++i) {
      const double relative = action[layout_.action_to_legs[i]];
      row.targets[i] = commanded ? row.command[kCommandLegs + i]
                                 : layout_.joint_offsets[i] + layout_.action_scale * relative;
    }
  }
  std::copy_n(row.command + kCommandArm, kJoints - kLegJoints, row.targets + kLegJoints);
  std::copy_n(action, kLegJoints, row.memory);
}

}  // namespace sumo
