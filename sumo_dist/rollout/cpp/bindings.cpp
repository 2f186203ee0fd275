// The Python face of the engine: addresses and arrays in, arrays filled in place.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine.h"
#include "g1_gait.h"
#include "hold_targets.h"
#include "kernels.h"
#include "mlp.h"
#include "spot_relic.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Address = std::uintptr_t;

template <typename T, int N>
using Array = nb::ndarray<T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
using Vector = Array<const float, 1>;
// As sumo_dist.policies.network.Layer: weight, bias, activation, scale and shift of the norm, gain.
using Layer = std::tuple<Array<const float, 2>, Vector, std::string,
                         std::optional<std::pair<Vector, Vector>>, std::optional<Vector>>;

template <typename T>
T at(Address address) {
  return reinterpret_cast<T>(address);
}

void require(bool condition, const char* message) {
  if (!condition) throw std::invalid_argument(message);
}

sumo::Activation activation(const std::string& name) {
  static const std::map<std::string, sumo::Activation> kByName{
      {"linear", sumo::Activation::kLinear},
      {"elu", sumo::Activation::kElu},
      {"silu", sumo::Activation::kSilu},
      {"tanh", sumo::Activation::kTanh}};
  const auto found = kByName.find(name);
  require(found != kByName.end(), "unknown activation; valid: linear, elu, silu, tanh");
  return found->second;
}

sumo::Mlp make_network(const std::vector<Layer>& layers, const sumo::Kernel& kernel) {
  std::vector<sumo::Dense> dense;
  for (const auto& [weights, bias, name, norm, gain] : layers) {
    const std::size_t outputs = weights.shape(0);
    const auto numbers = [&](const Vector& v) {
      require(v.shape(0) == outputs, "a layer's weights, biases, norm and gain do not fit");
      return v.data();
    };
    dense.push_back({static_cast<int>(weights.shape(1)), static_cast<int>(outputs), weights.data(),
                     numbers(bias), activation(name), norm ? numbers(norm->first) : nullptr,
                     norm ? numbers(norm->second) : nullptr, gain ? numbers(*gain) : nullptr});
  }
  return sumo::Mlp(kernel, dense);
}

const sumo::Kernel& kernel(bool portable) {
  return portable ? *sumo::kernels().front() : *sumo::kernels().back();
}

const sumo::Kernel& kernel_named(const std::string& name) {
  for (const sumo::Kernel* known : sumo::kernels())
    if (known->name == name) return *known;
  throw std::invalid_argument("no kernel of this name runs on this CPU");
}

template <typename Kind, typename Layout>
std::shared_ptr<sumo::Policy> make_policy(const std::vector<Layer>& layers, const Layout& layout,
                                          bool portable) {
  return std::make_shared<Kind>(make_network(layers, kernel(portable)), layout);
}

// One network evaluation per row, for tests and timing of the kernels.
void evaluate(const std::vector<Layer>& layers, Array<const float, 2> inputs,
              Array<float, 2> outputs, const std::string& name) {
  const sumo::Mlp network = make_network(layers, kernel_named(name));
  const int rows = static_cast<int>(inputs.shape(0));
  require(static_cast<int>(inputs.shape(1)) == network.inputs() &&
              static_cast<int>(outputs.shape(1)) == network.outputs() &&
              outputs.shape(0) == inputs.shape(0),
          "inputs or outputs do not fit the network");
  sumo::Mlp::Workspace work = network.make_workspace(rows);
  for (int r = 0; r < rows; ++r)
    std::copy_n(inputs.data() + static_cast<long>(r) * network.inputs(), network.inputs(),
                work.input(r));
  network.forward(rows, work);
  for (int r = 0; r < rows; ++r)
    std::copy_n(work.output(r), network.outputs(),
                outputs.data() + static_cast<long>(r) * network.outputs());
}

// One policy step of one robot.
void step(const sumo::Policy& policy, Array<const double, 1> qpos, Array<const double, 1> qvel,
          Array<const double, 1> command, Array<float, 1> memory, Array<double, 1> targets) {
  const sumo::PolicySizes sizes = policy.sizes();
  require(static_cast<int>(qpos.size()) >= sizes.qpos &&
              static_cast<int>(qvel.size()) >= sizes.qvel &&
              static_cast<int>(command.size()) == sizes.command &&
              static_cast<int>(memory.size()) == sizes.memory &&
              static_cast<int>(targets.size()) == sizes.targets,
          "arrays do not fit the policy");
  sumo::PolicyRow row{qpos.data(), qvel.data(), command.data(), memory.data(), targets.data()};
  policy.step(&row, 1, *policy.make_workspace(1));
}

sumo::Simulation make_simulation(Address data, Address qpos, Address qvel, Address ctrl,
                                 const std::vector<std::pair<Address, Address>>& frames,
                                 const std::vector<Address>& warnings) {
  sumo::Simulation sim{
      at<void*>(data), at<const double*>(qpos), at<const double*>(qvel), at<double*>(ctrl), {}, {}};
  for (const auto& [position, rotation] : frames)
    sim.frames.push_back({at<const double*>(position), at<const double*>(rotation)});
  for (const Address counter : warnings) sim.warnings.push_back(at<int*>(counter));
  return sim;
}

// From one row to the next; a single row is shared by all.
template <typename T>
long stride(const Array<T, 2>& rows) {
  return rows.shape(0) == 1 ? 0 : static_cast<long>(rows.shape(1));
}

void rollout(sumo::Engine& engine, Array<const double, 2> starts, Array<const float, 2> memories,
             Array<const double, 3> commands, Array<const int, 1> models, Array<double, 3> states,
             Array<double, 3> targets, Array<double, 4> positions, Array<double, 5> rotations,
             Array<float, 2> memory_out, Array<bool, 1> valid) {
  const sumo::Request request{static_cast<int>(commands.shape(0)),
                              static_cast<int>(commands.shape(1)),
                              starts.data(),
                              stride(starts),
                              memories.data(),
                              stride(memories),
                              commands.data(),
                              models.data(),
                              states.data(),
                              targets.data(),
                              positions.data(),
                              rotations.data(),
                              memory_out.data(),
                              valid.data()};
  const nb::gil_scoped_release released;
  engine.rollout(request);
}

}  // namespace

NB_MODULE(_native, m) {
  m.attr("SOURCE_HASH") = SUMO_SOURCE_HASH;
  m.def("kernels", [] {  // those that this CPU can run: their names, and that of their bits
    std::vector<std::pair<std::string, std::string>> names;
    for (const sumo::Kernel* known : sumo::kernels()) names.emplace_back(known->name, known->bits);
    return names;
  });
  m.def("evaluate", &evaluate, "layers"_a, "inputs"_a, "outputs"_a, "kernel"_a);

  nb::class_<sumo::Policy>(m, "Policy")
      .def("step", &step, "qpos"_a, "qvel"_a, "command"_a, "memory"_a, "targets"_a);
  using sumo::SpotLayout;
  nb::class_<SpotLayout>(m, "SpotLayout")
      .def(nb::init<>())
      .def_rw("joints_to_network", &SpotLayout::joints_to_network)
      .def_rw("action_to_legs", &SpotLayout::action_to_legs)
      .def_rw("joint_offsets", &SpotLayout::joint_offsets)
      .def_rw("action_scale", &SpotLayout::action_scale)
      .def_rw("leg_size", &SpotLayout::leg_size)
      .def_rw("command_size", &SpotLayout::command_size)
      .def_rw("command_arm", &SpotLayout::command_arm)
      .def_rw("command_legs", &SpotLayout::command_legs);
  m.def("spot_relic", &make_policy<sumo::SpotRelic, SpotLayout>, "layers"_a, "layout"_a,
        "portable"_a);

  using sumo::G1Layout;
  nb::class_<G1Layout>(m, "G1Layout")
      .def(nb::init<>())
      .def_rw("joint_offsets", &G1Layout::joint_offsets)
      .def_rw("action_scale", &G1Layout::action_scale)
      .def_rw("spin_scale", &G1Layout::spin_scale)
      .def_rw("joint_speed_scale", &G1Layout::joint_speed_scale)
      .def_rw("phases", &G1Layout::phases)
      .def_rw("standing", &G1Layout::standing)
      .def_rw("stand_below", &G1Layout::stand_below)
      .def_rw("feedback_gain", &G1Layout::feedback_gain)
      .def_rw("feedback_limit", &G1Layout::feedback_limit)
      .def_rw("feedback_share", &G1Layout::feedback_share)
      .def_rw("first_arm", &G1Layout::first_arm)
      .def_rw("arm_size", &G1Layout::arm_size)
      .def_rw("command_size", &G1Layout::command_size)
      .def_rw("command_arms", &G1Layout::command_arms)
      .def_rw("command_follows", &G1Layout::command_follows)
      .def_rw("memory_size", &G1Layout::memory_size)
      .def_rw("memory_gait", &G1Layout::memory_gait)
      .def_rw("memory_velocity", &G1Layout::memory_velocity);
  m.def("g1_gait", &make_policy<sumo::G1Gait, G1Layout>, "layers"_a, "layout"_a, "portable"_a);

  m.def(
      "hold_targets",
      [](int targets) -> std::shared_ptr<sumo::Policy> {
        return std::make_shared<sumo::HoldTargets>(targets);
      },
      "targets"_a);

  nb::class_<sumo::Simulation>(m, "Simulation")
      .def(
          "__init__",
          [](sumo::Simulation* self, Address data, Address qpos, Address qvel, Address ctrl,
             const std::vector<std::pair<Address, Address>>& frames,
             const std::vector<Address>& warnings) {
            new (self) sumo::Simulation(make_simulation(data, qpos, qvel, ctrl, frames, warnings));
          },
          "data"_a, "qpos"_a, "qvel"_a, "ctrl"_a, "frames"_a, "warnings"_a);

  nb::class_<sumo::Physics>(m, "Physics")
      .def(
          "__init__",
          [](sumo::Physics* self, const std::vector<Address>& models, Address step,
             Address set_state, Address get_state, Address kinematics, int signature,
             int state_size, int nq, int nv, int nu, int qpos, int substeps) {
            std::vector<const void*> pointers;
            for (const Address model : models) pointers.push_back(at<const void*>(model));
            new (self) sumo::Physics{pointers,
                                     at<decltype(sumo::Physics::step)>(step),
                                     at<decltype(sumo::Physics::set_state)>(set_state),
                                     at<decltype(sumo::Physics::get_state)>(get_state),
                                     at<decltype(sumo::Physics::kinematics)>(kinematics),
                                     signature,
                                     state_size,
                                     nq,
                                     nv,
                                     nu,
                                     qpos,
                                     substeps};
          },
          "models"_a, "step"_a, "set_state"_a, "get_state"_a, "kinematics"_a, "signature"_a,
          "state_size"_a, "nq"_a, "nv"_a, "nu"_a, "qpos"_a, "substeps"_a);

  nb::class_<sumo::Engine>(m, "Engine")
      .def(nb::init<const sumo::Physics&, std::shared_ptr<const sumo::Policy>,
                    const std::vector<sumo::Simulation>&, int>(),
           "physics"_a, "policy"_a, "simulations"_a, "group"_a)
      .def("rollout", &rollout, "starts"_a, "memories"_a, "commands"_a, "models"_a, "states"_a,
           "targets"_a, "positions"_a, "rotations"_a, "memory_out"_a, "valid"_a);
}
