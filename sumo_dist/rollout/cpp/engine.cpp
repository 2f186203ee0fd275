#include "engine.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace sumo {
namespace {

constexpr double kHuge = 1e10;  // where MuJoCo itself calls a value bad
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

bool sane(const double* values, int size) {
  return std::all_of(values, values + size, [](double x) { return std::fabs(x) <= kHuge; });
}

}  // namespace

// Rows [first, first + count) of a request on the simulation of one lane.
class Engine::Group {
 public:
  Group(const Engine& engine, const Request& request, Lane& lane, int first, int count)
      : physics_(engine.physics_),
        policy_(*engine.policy_),
        sizes_(engine.policy_->sizes()),
        frames_(engine.frames_),
        request_(request),
        lane_(lane),
        sim_(lane.simulation),
        first_(first) {
    lane_.live.clear();
    for (int i = 0; i < count; ++i) reset(i);
  }

  void run() {
    auto& live = lane_.live;
    for (int tick = 0; tick < request_.ticks && !live.empty(); ++tick) {
      evaluate_policy(tick);
      const auto diverges = [&](int i) { return !advance(i, tick); };
      live.erase(std::remove_if(live.begin(), live.end(), diverges), live.end());
    }
  }

 private:
  void reset(int i) {
    const double* start = request_.starts + row_of(i) * request_.start_stride;
    std::copy_n(start, physics_.state_size, state(i));
    std::copy_n(request_.memories + row_of(i) * request_.memory_stride, sizes_.memory, memory(i));
    request_.valid[row_of(i)] = true;
    lane_.live.push_back(i);
  }

  void evaluate_policy(int tick) {
    PolicyRow* row = lane_.rows.data();
    for (const int i : lane_.live) {
      const double* qpos = tick > 0 ? state_at(i, tick - 1) : state(i) + physics_.qpos;
      const double* command = request_.commands + at(i, tick) * sizes_.command;
      *row++ = {qpos, qpos + physics_.nq, command, memory(i), targets_at(i, tick)};
    }
    policy_.step(lane_.rows.data(), static_cast<int>(lane_.live.size()), *lane_.workspace);
  }

  // One policy step of physics; false if the row diverged.
  bool advance(int i, int tick) {
    physics_.set_state(model(i), sim_.data, state(i), physics_.signature);
    std::copy_n(targets_at(i, tick), physics_.nu, sim_.ctrl);
    for (int* warning : sim_.warnings) *warning = 1;  // MuJoCo logs a counter's first increment
    for (int substep = 0; substep < physics_.substeps; ++substep) {
      physics_.step(model(i), sim_.data);
      // mj_step leaves frames of the state it started from: those of the last recorded row.
      if (substep == 0 && tick > 0) record_frames(i, tick - 1);
      if (!healthy()) {
        invalidate(i, tick);
        return false;
      }
    }
    physics_.get_state(model(i), sim_.data, state(i), physics_.signature);
    std::copy_n(sim_.qvel, physics_.nv, std::copy_n(sim_.qpos, physics_.nq, state_at(i, tick)));
    if (tick == request_.ticks - 1) {
      physics_.kinematics(model(i), sim_.data);
      record_frames(i, tick);
    }
    return true;
  }

  bool healthy() const {
    const auto raised = [](const int* warning) { return *warning != 1; };
    return sane(sim_.qpos, physics_.nq) && sane(sim_.qvel, physics_.nv) &&
           std::none_of(sim_.warnings.begin(), sim_.warnings.end(), raised);
  }

  void record_frames(int i, int tick) const {
    double* position = request_.positions + at(i, tick) * frames_ * 3;
    double* rotation = request_.rotations + at(i, tick) * frames_ * 9;
    for (const Frame& frame : sim_.frames) {
      position = std::copy_n(frame.position, 3, position);
      rotation = std::copy_n(frame.rotation, 9, rotation);
    }
  }

  void invalidate(int i, int tick) {
    const auto fill = [&](double* array, long size) {
      std::fill(array + at(i, tick) * size, array + at(i, request_.ticks) * size, kNaN);
    };
    fill(request_.states, physics_.nq + physics_.nv);
    fill(request_.targets, physics_.nu);
    fill(request_.positions, frames_ * 3L);
    fill(request_.rotations, frames_ * 9L);
    std::fill_n(memory(i), sizes_.memory, std::numeric_limits<float>::quiet_NaN());
    request_.valid[row_of(i)] = false;
  }

  double* state(int i) { return lane_.states.data() + static_cast<long>(i) * physics_.state_size; }
  double* state_at(int i, int tick) const {
    return request_.states + at(i, tick) * (physics_.nq + physics_.nv);
  }
  double* targets_at(int i, int tick) const { return request_.targets + at(i, tick) * physics_.nu; }
  long row_of(int i) const { return first_ + i; }
  long at(int i, int tick) const { return row_of(i) * request_.ticks + tick; }
  const void* model(int i) const { return physics_.models[request_.models[row_of(i)]]; }
  float* memory(int i) const { return request_.memory_out + row_of(i) * sizes_.memory; }

  const Physics& physics_;
  const Policy& policy_;
  const PolicySizes sizes_;
  const int frames_;
  const Request& request_;
  Lane& lane_;
  const Simulation& sim_;
  const int first_;
};

Engine::Engine(const Physics& physics, std::shared_ptr<const Policy> policy,
               const std::vector<Simulation>& simulations, int group)
    : physics_(physics),
      policy_(std::move(policy)),
      group_(group),
      pool_(static_cast<int>(simulations.size())) {
  if (simulations.empty() || group < 1)
    throw std::invalid_argument("no simulation, or a group of no rows");
  const PolicySizes sizes = policy_->sizes();
  if (sizes.qpos > physics_.nq || sizes.qvel > physics_.nv || sizes.targets != physics_.nu)
    throw std::invalid_argument("the policy drives another robot than the model's");
  frames_ = static_cast<int>(simulations.front().frames.size());
  const std::size_t states = static_cast<std::size_t>(group) * physics_.state_size;
  for (const Simulation& simulation : simulations)
    lanes_.push_back({simulation,
                      policy_->make_workspace(group),
                      std::vector<PolicyRow>(group),
                      std::vector<double>(states),
                      {}});
}

int Engine::group_size(int rows) const {
  const int threads = pool_.size();
  const int waves = (rows + threads * group_ - 1) / (threads * group_);
  return (rows + threads * waves - 1) / (threads * waves);
}

void Engine::rollout(const Request& request) {
  const std::lock_guard<std::mutex> lock(busy_);
  const int size = group_size(request.rows);
  const int groups = (request.rows + size - 1) / size;
  pool_.run(groups, [&](int index, int thread) {
    const int first = index * size;
    Group(*this, request, lanes_[thread], first, std::min(size, request.rows - first)).run();
  });
}

}  // namespace sumo
