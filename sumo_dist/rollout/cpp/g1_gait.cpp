#include "g1_gait.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "rotation.h"

namespace sumo {
namespace {

constexpr int kJoints = G1Layout::kJoints;
constexpr int kFirstArm = 15;  // the arms are the last joints, left before right
constexpr int kArmJoints = 7;

// The command, and where its parts start.
constexpr int kCommand = 19;
constexpr int kCommandArms = 3;
constexpr int kCommandFollows = 17;

// The memory, behind the last action.
constexpr int kGait = kJoints;
constexpr int kVelocity = kGait + 1;
constexpr int kMemory = kVelocity + 3;
constexpr float kStanding = -1.0f;

struct Work final : Policy::Workspace {
  explicit Work(Mlp::Workspace network) : network(std::move(network)) {}
  Mlp::Workspace network;
};

bool commanded(const double* command, int joint) {
  return joint >= kFirstArm &&
         command[kCommandFollows + (joint - kFirstArm) / kArmJoints] > 0.5;
}

}  // namespace

struct G1Gait::Moment {
  float gait;
  double wish[3];  // the corrected velocity command
};

G1Gait::G1Gait(Mlp network, const G1Layout& layout)
    : network_(std::move(network)), layout_(layout) {
  if (network_.inputs() != kObservation || network_.outputs() != kJoints)
    throw std::invalid_argument("g1_gait needs a network of 100 inputs and 29 outputs");
  if (layout_.phases.size() < 2) throw std::invalid_argument("g1_gait: a gait without phases");
}

PolicySizes G1Gait::sizes() const { return {7 + kJoints, 6 + kJoints, kCommand, kMemory, kJoints}; }

std::unique_ptr<Policy::Workspace> G1Gait::make_workspace(int rows) const {
  return std::make_unique<Work>(network_.make_workspace(rows));
}

void G1Gait::step(PolicyRow* rows, int count, Workspace& work) const {
  Mlp::Workspace& network = static_cast<Work&>(work).network;
  for (int i = 0; i < count; ++i) observe(rows[i], network.input(i));
  network_.forward(count, network);
  for (int i = 0; i < count; ++i) act(rows[i], network.output(i));
}

// Filters the velocity in memory and begins or ends the gait there.
G1Gait::Moment G1Gait::advance(const PolicyRow& row) const {
  const Rotation base = rotation(row.qpos + 3);
  const double now[3] = {base.into_base(row.qvel, 0), base.into_base(row.qvel, 1), row.qvel[5]};
  float* velocity = row.memory + kVelocity;
  for (int i = 0; i < 3; ++i) {
    const double before = velocity[i];
    velocity[i] = static_cast<float>(before + layout_.feedback_share * (now[i] - before));
  }
  const double* wanted = row.command;
  const double norm2 =
      wanted[0] * wanted[0] + wanted[1] * wanted[1] + wanted[2] * wanted[2];
  const bool stands = norm2 < layout_.stand_below * layout_.stand_below;
  float& gait = row.memory[kGait];
  gait = stands ? kStanding : gait == kStanding ? 0.0f : gait;
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
  for (int i = 0; i < kJoints; ++i) *out++ = commanded(row.command, i) ? 0.0f : row.memory[i];
  for (int i = 3; i < 6; ++i) *out++ = static_cast<float>(layout_.spin_scale * row.qvel[i]);
  for (const int i : {2, 0, 1}) *out++ = static_cast<float>(now.wish[i]);
  out = std::copy_n(phases.begin(), 2, out);
  for (int i = 0; i < kJoints; ++i) {
    const double relative = row.qpos[7 + i] - layout_.joint_offsets[i];
    *out++ = commanded(row.command, i) ? 0.0f : static_cast<float>(relative);
  }
  for (int i = 0; i < kJoints; ++i) {
    const double speed = layout_.joint_speed_scale * row.qvel[6 + i];
    *out++ = commanded(row.command, i) ? 0.0f : static_cast<float>(speed);
  }
  const Rotation base = rotation(row.qpos + 3);
  for (int i = 0; i < 3; ++i) *out++ = static_cast<float>(-base.row[2][i]);  // gravity
  std::copy_n(phases.begin() + 2, 2, out);
}

void G1Gait::act(const PolicyRow& row, const float* action) const {
  for (int i = 0; i < kJoints; ++i) {
    const double relative = action[i];
    row.targets[i] = commanded(row.command, i)
                         ? row.command[kCommandArms + i - kFirstArm]
                         : layout_.joint_offsets[i] + layout_.action_scale * relative;
  }
  std::copy_n(action, kJoints, row.memory);
  float& gait = row.memory[kGait];
  if (gait != kStanding)
    gait = std::fmod(gait + 1.0f, static_cast<float>(layout_.phases.size() - 1));
}

}  // namespace sumo
