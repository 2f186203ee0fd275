// Policy-in-the-loop rollouts: groups of rows in lockstep, so that the policy runs in batches.
//
// A thread has one simulation, which its rows use in turn: what a step works with stays in the
// cache, where one simulation for each row would not fit.
//
// MuJoCo is reached through addresses alone (its functions, models, data and their arrays): struct
// layouts change between releases, the functions' signatures do not.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "policy.h"
#include "thread_pool.h"

namespace sumo {

struct Physics {
  std::vector<const void*> models;  // the model itself, then its variations, equal in all sizes
  void (*step)(const void* model, void* data);
  void (*set_state)(const void* model, void* data, const double* state, int signature);
  void (*get_state)(const void* model, const void* data, double* state, int signature);
  void (*kinematics)(const void* model, void* data);
  int signature;   // of the state that resets a simulation
  int state_size;  // of that state
  int nq, nv, nu;
  int qpos;      // where qpos and qvel begin in that state
  int substeps;  // physics steps per policy step
};

struct Frame {
  const double* position;  // 3
  const double* rotation;  // 3 x 3, row-major
};

struct Simulation {
  void* data;
  const double* qpos;
  const double* qvel;
  double* ctrl;
  std::vector<Frame> frames;
  std::vector<int*> warnings;  // counters of the warnings that mean divergence
};

struct Request {
  int rows, ticks;
  const double* starts;   // states to reset to, as of Physics::signature
  long start_stride;      // from a row's start to the next row's; 0 if all share one
  const float* memories;  // before the first step
  long memory_stride;
  const double* commands;  // rows x ticks x command
  const int* models;       // rows, which of Physics::models
  // Results, see sumo_dist/rollout/interface.py.
  double* states;     // rows x ticks x (nq + nv)
  double* targets;    // rows x ticks x nu
  double* positions;  // rows x ticks x frames x 3
  double* rotations;  // rows x ticks x frames x 9
  float* memory_out;  // rows x memory
  bool* valid;        // rows
};

class Engine {
 public:
  // A thread for each simulation, for groups of up to `group` rows.
  Engine(const Physics& physics, std::shared_ptr<const Policy> policy,
         const std::vector<Simulation>& simulations, int group);

  void rollout(const Request& request);

 private:
  class Group;

  struct Lane {  // what one thread works with
    Simulation simulation;
    std::unique_ptr<Policy::Workspace> workspace;
    std::vector<PolicyRow> rows;
    std::vector<double> states;  // of the group's rows, between their steps
    std::vector<int> live;
  };

  int group_size(int rows) const;

  Physics physics_;
  std::shared_ptr<const Policy> policy_;
  int group_;
  int frames_;
  std::vector<Lane> lanes_;
  std::mutex busy_;
  ThreadPool pool_;
};

}  // namespace sumo
