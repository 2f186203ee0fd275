#include "g1_gait.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "rotation.h"

namespace sumo {
namespace {

// The last action and joints twice; spin, gravity and wish; both phases' cosines and sines.
int observation_size(const G1Layout& layout) { return 3 * layout.joints() + 9 + G1Layout::kPhases; }

void check(const G1Layout& layout) {
  const int arm_joints = layout.joints() - layout.first_arm;
  if (layout.first_arm < 0 || arm_joints < 0 || layout.arm_size < 1 ||
      arm_joints % layout.arm_size != 0)
    throw std::invalid_argument("g1_gait: numbers of joints do not fit");
  const int arms = arm_joints / layout.arm_size;
  if (layout.command_size < 3 || layout.command_arms < 0 ||
      layout.command_arms + arm_joints > layout.command_size || layout.command_follows < 0 ||
      layout.command_follows + arms > layout.command_size)
    throw std::invalid_argument("g1_gait: arms lie outside the command");
  if (layout.memory_gait < layout.joints() || layout.memory_gait >= layout.memory_size ||
      layout.memory_velocity < layout.joints() || layout.memory_velocity + 3 > layout.memory_size)
    throw std::invalid_argument("g1_gait: gait or velocity lie outside the memory");
  if (layout.phases.size() < 2) throw std::invalid_argument("g1_gait: a gait without phases");
}

struct Work final : Policy::Workspace {
  explicit Work(Mlp::Workspace network) : network(std::move(network)) {}
  Mlp::Workspace network;
};

}  // namespace

struct G1Gait::Moment {
  float gait;
  double wish[3];  // the corrected velocity command
};

G1Gait::G1Gait(Mlp network, const G1Layout& layout)
    : network_(std::move(network)), layout_(layout) {
  check(layout_);
  if (network_.inputs() != observation_size(layout_) || network_.outputs() != layout_.joints())
    throw std::invalid_argument("g1_gait: the network does not fit the layout");
  follows_.assign(layout_.first_arm, -1);
  for (int i = 0; i < layout_.joints() - layout_.first_arm; ++i)
    follows_.push_back(layout_.command_follows + i / layout_.arm_size);
}

PolicySizes G1Gait::sizes() const {
  const int joints = layout_.joints();
  return {7 + joints, 6 + joints, layout_.command_size, layout_.memory_size, joints};
}

std::unique_ptr<Policy::Workspace> G1Gait::make_workspace(int rows) const {
  return std::make_unique<Work>(network_.make_workspace(rows));
}

void G1Gait::step(PolicyRow* rows, int count, Workspace& work) const {
  Mlp::Workspace& network = static_cast<Work&>(work).network;
  for (int i = 0; i < count; ++i) observe(rows[i], network.input(i));
  network_.forward(count, network);
  for (int i = 0; i < count; ++i) act(rows[i], network.output(i));
}

bool G1Gait::commanded(const PolicyRow& row, int joint) const {
  return follows_[joint] >= 0 && row.command[follows_[joint]] > 0.5;
}

// Filters the velocity in memory and begins or ends the gait there.
G1Gait::Moment G1Gait::advance(const PolicyRow& row) const {
  const Rotation base = rotation(row.qpos + 3);
  const double now[3] = {base.into_base(row.qvel, 0), base.into_base(row.qvel, 1), row.qvel[5]};
  float* velocity = row.memory + layout_.memory_velocity;
  for (int i = 0; i < 3; ++i) {
    const double before = velocity[i];
    velocity[i] = static_cast<float>(before + layout_.feedback_share * (now[i] - before));
  }
  const double* wanted = row.command;
  const double norm2 = wanted[0] * wanted[0] + wanted[1] * wanted[1] + wanted[2] * wanted[2];
  const bool stands = norm2 < layout_.stand_below * layout_.stand_below;
  float& gait = row.memory[layout_.memory_gait];
  gait = stands ? layout_.standing : gait == layout_.standing ? 0.0f : gait;
  Moment moment{gait, {}};
  for (int i = 0; i < 3 && !stands; ++i) {
    const double wish = wanted[i] + layout_.feedback_gain[i] * (wanted[i] - velocity[i]);
    moment.wish[i] = std::min(std::max(wish, -layout_.feedback_limit), layout_.feedback_limit);
  }
  return moment;
}

void G1Gait::observe(const PolicyRow& row, float* out) const {
  const Moment now = advance(row);
  const int last = static_cast<int>(layout_.phases.size()) - 1;
  const bool walks = now.gait >= 0.0f && now.gait < static_cast<float>(last);
  const auto& phases = layout_.phases[walks ? static_cast<int>(now.gait) : last];
  const int joints = layout_.joints();
  for (int i = 0; i < joints; ++i) *out++ = commanded(row, i) ? 0.0f : row.memory[i];
  for (int i = 3; i < 6; ++i) *out++ = static_cast<float>(layout_.spin_scale * row.qvel[i]);
  for (const int i : {2, 0, 1}) *out++ = static_cast<float>(now.wish[i]);
  out = std::copy_n(phases.begin(), 2, out);
  for (int i = 0; i < joints; ++i) {
    const double relative = row.qpos[7 + i] - layout_.joint_offsets[i];
    *out++ = commanded(row, i) ? 0.0f : static_cast<float>(relative);
  }
  for (int i = 0; i < joints; ++i) {
    const double speed = layout_.joint_speed_scale * row.qvel[6 + i];
    *out++ = commanded(row, i) ? 0.0f : static_cast<float>(speed);
  }
  const Rotation base = rotation(row.qpos + 3);
  for (int i = 0; i < 3; ++i) *out++ = static_cast<float>(-base.row[2][i]);  // gravity
  std::copy_n(phases.begin() + 2, 2, out);
}

void G1Gait::act(const PolicyRow& row, const float* action) const {
  const int joints = layout_.joints();
  for (int i = 0; i < joints; ++i) {
    const double relative = action[i];
    row.targets[i] = commanded(row, i) ? row.command[layout_.command_arms + i - layout_.first_arm]
                                       : layout_.joint_offsets[i] + layout_.action_scale * relative;
  }
  std::copy_n(action, joints, row.memory);
  float& gait = row.memory[layout_.memory_gait];
  if (gait != layout_.standing)
    gait = std::fmod(gait + 1.0f, static_cast<float>(layout_.phases.size() - 1));
}

}  // namespace sumo
