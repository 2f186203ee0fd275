// A low-level policy: reads the robot's state and a command, writes joint targets.
#pragma once

#include <memory>

namespace sumo {

struct PolicyRow {
  const double* qpos;
  const double* qvel;
  const double* command;
  float* memory;    // updated in place
  double* targets;  // written
};

struct PolicySizes {
  int qpos;  // leading entries of qpos and qvel that the policy reads
  int qvel;
  int command;
  int memory;
  int targets;
};

class Policy {
 public:
  // Scratch space of one thread, for up to the number of rows it was made for.
  struct Workspace {
    virtual ~Workspace() = default;
  };

  virtual ~Policy() = default;
  virtual PolicySizes sizes() const = 0;
  virtual std::unique_ptr<Workspace> make_workspace(int rows) const = 0;
  virtual void step(PolicyRow* rows, int count, Workspace& work) const = 0;
};

}  // namespace sumo
