#include "spot_relic.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "rotation.h"

namespace sumo {
namespace {

// Velocity, rotation and gravity in the base's frame; the command; joints twice; the last action.
int observation_size(const SpotLayout& layout) {
  return 9 + layout.command_size + 2 * layout.joints() + layout.leg_joints();
}

// Whether all numbers are indices of an array of this size.
bool within(const std::vector<int>& numbers, int size) {
  return std::all_of(numbers.begin(), numbers.end(), [size](int i) { return i >= 0 && i < size; });
}

void check(const SpotLayout& layout) {
  const int legs = layout.leg_joints();
  if (static_cast<int>(layout.joints_to_network.size()) != layout.joints() ||
      layout.arm_joints() < 0 || layout.leg_size < 1 || legs % layout.leg_size != 0)
    throw std::invalid_argument("spot_relic: numbers of joints do not fit");
  if (!within(layout.joints_to_network, layout.joints()) || !within(layout.action_to_legs, legs))
    throw std::invalid_argument("spot_relic: joint index out of range");
  if (layout.command_arm < 0 || layout.command_arm + layout.arm_joints() > layout.command_size ||
      layout.command_legs < 0 || layout.command_legs + legs > layout.command_size)
    throw std::invalid_argument("spot_relic: joint targets lie outside the command");
}

struct Work final : Policy::Workspace {
  explicit Work(Mlp::Workspace network) : network(std::move(network)) {}
  Mlp::Workspace network;
};

}  // namespace

SpotRelic::SpotRelic(Mlp network, const SpotLayout& layout)
    : network_(std::move(network)), layout_(layout) {
  check(layout_);
  if (network_.inputs() != observation_size(layout_) || network_.outputs() != layout_.leg_joints())
    throw std::invalid_argument("spot_relic: the network does not fit the layout");
}

PolicySizes SpotRelic::sizes() const {
  const int joints = layout_.joints();
  return {7 + joints, 6 + joints, layout_.command_size, layout_.leg_joints(), joints};
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
  for (int i = 0; i < layout_.command_size; ++i) *out++ = static_cast<float>(row.command[i]);
  for (const int joint : layout_.joints_to_network)
    *out++ = static_cast<float>(row.qpos[7 + joint] - layout_.joint_offsets[joint]);
  for (const int joint : layout_.joints_to_network)
    *out++ = static_cast<float>(row.qvel[6 + joint]);
  std::copy_n(row.memory, layout_.leg_joints(), out);
}

void SpotRelic::act(const PolicyRow& row, const float* action) const {
  const int leg_joints = layout_.leg_joints(), size = layout_.leg_size;
  const double* legs = row.command + layout_.command_legs;
  for (int leg = 0; leg < leg_joints; leg += size) {
    const bool commanded =
        std::any_of(legs + leg, legs + leg + size, [](double target) { return target != 0.0; });
    for (int i = leg; i < leg + size; ++i) {
      const double relative = action[layout_.action_to_legs[i]];
      row.targets[i] =
          commanded ? legs[i] : layout_.joint_offsets[i] + layout_.action_scale * relative;
    }
  }
  std::copy_n(row.command + layout_.command_arm, layout_.arm_joints(), row.targets + leg_joints);
  std::copy_n(action, leg_joints, row.memory);
}

}  // namespace sumo
