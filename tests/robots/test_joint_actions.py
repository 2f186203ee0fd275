"""Joint targets in place of a policy's command: their action space, contract and rollouts."""

import copy
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.model.scene import PLANNING, Scene, compile_model
from sumo_dist.model.settle import settled_stand
from sumo_dist.policies import hold, load_policy
from sumo_dist.robots.compatibility import check
from sumo_dist.robots.g1 import G1, SIDES, g1_actions
from sumo_dist.robots.joint_actions import joint_actions
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.robots.spot import SPOT, spot_actions
from sumo_dist.rollout import make_engine

ARM = ("arm_sh0", "arm_sh1", "arm_el0")


@pytest.fixture(scope="module", params=[SPOT, G1], ids=lambda robot: robot.name)
def robot(request):
    return request.param


@pytest.fixture(scope="module")
def model(robot):
    return compile_model(Scene(robot, floor_friction=1.0, floor_priority=0), PLANNING)


@pytest.fixture(scope="module")
def controller(robot):
    return hold.hold_targets(load_policy(robot.policy).contract)


def test_all_joints_around_the_stance(robot):
    actions = joint_actions(robot, reach=0.3)
    assert actions.names == robot.joints
    np.testing.assert_array_equal(actions.default, robot.stand)
    np.testing.assert_array_equal(actions.to_command(actions.default), robot.stand)
    assert (actions.upper - actions.default <= 0.3 + 1e-12).all()
    assert (actions.default - actions.lower <= 0.3 + 1e-12).all()
    assert not actions.base.any()


def test_safety_limits_go_before_the_reach():
    actions = joint_actions(SPOT, reach=np.inf)
    np.testing.assert_array_equal(actions.lower, SPOT.safety.target_lower)
    np.testing.assert_array_equal(actions.upper, SPOT.safety.target_upper)
    gripper = joint_actions(SPOT, ("arm_f1x",), reach=0.5)
    assert (gripper.lower, gripper.upper) == (-0.5, 0.0)


def test_some_joints_in_any_order_and_the_others_rest():
    actions = joint_actions(SPOT, ARM[::-1])
    assert (actions.names, actions.size) == (ARM[::-1], 3)
    command = actions.to_command(np.array([1.0, 2.0, 3.0]))
    expected = np.array(SPOT.stand)
    expected[12:15] = 3.0, 2.0, 1.0
    np.testing.assert_array_equal(command, expected)


def test_around_other_targets():
    around = np.array(SPOT.stand) + 0.01 * np.arange(19) * (np.arange(19) < 18)
    actions = joint_actions(SPOT, ARM, reach=0.1, around=around)
    np.testing.assert_array_equal(actions.default, around[12:15])
    np.testing.assert_array_equal(actions.to_command(actions.default), around)


def test_a_batch_gives_the_bits_of_its_rows(robot):
    actions = joint_actions(robot)
    unit = np.random.default_rng(0).uniform(-1, 1, (3, 4, actions.size))
    whole = actions.commands(unit)
    assert whole.shape == (3, 4, len(robot.joints))
    np.testing.assert_array_equal(whole[1, 2], actions.commands(unit[1, 2]))


@pytest.mark.parametrize(
    ("robot", "arguments", "message"),
    [
        (SPOT, {"joints": ("elbow",)}, "unknown joint 'elbow'; valid: arm_el0"),
        (SPOT, {"joints": ()}, "each once"),
        (SPOT, {"joints": ("fl_hx", "fl_hx")}, "each once"),
        (SPOT, {"reach": 0.0}, "must be positive"),
        (SPOT, {"reach": np.nan}, "must be positive"),
        (SPOT, {"around": np.zeros(3)}, r"shape \(3,\): robot 'spot' has 19 joints"),
        (SPOT, {"around": np.full(19, np.nan)}, "states no limits"),
        (SPOT, {"around": np.zeros(19)}, r"outside the safety limits: \['fl_kn'"),
        (G1, {"reach": np.inf}, "robot 'g1' states no limits of joint targets: give a reach"),
    ],
)
def test_refuses(robot, arguments, message):
    with pytest.raises(UsageError, match=message):
        joint_actions(robot, **arguments)


def test_joint_targets_fit_the_robot_by_either_name(robot, model, controller):
    assert controller.contract.name == "joint-targets"
    check(controller.contract, robot, model)
    check(controller.contract, replace(robot, policy="joint-targets"), model)


def test_joint_targets_need_the_robots_joints_gains_and_rate(robot, model, controller):
    contract = controller.contract
    for change, complaint in (
        ({"joints": contract.joints[::-1]}, "robot's joints"),
        ({"kp": (1.0, *contract.kp[1:])}, f"gains of {contract.joints[0]}"),
        ({"rate_hz": 100.0}, "rate: a tick is"),
    ):
        with pytest.raises(SumoError, match=complaint):
            check(replace(contract, **change), robot, model)


def holding(robot, model):
    """Targets (nu,) at which the servos carry the stance: by servos that hardly yield."""
    stiff = copy.copy(model)
    stiff.actuator_gainprm[:, 0] *= 50.0
    stiff.actuator_biasprm[:, 1] *= 50.0
    stiff.actuator_biasprm[:, 2] *= 7.0
    stiff.opt.timestep = 0.002
    data = mujoco.MjData(stiff)
    data.qpos[:], data.ctrl[:] = settled_stand(robot), robot.stand
    mujoco.mj_step(stiff, data, 1000)
    return robot.stand + data.actuator_force / model.actuator_gainprm[:, 0]


def test_soft_servos_hold_the_stance_if_their_targets_allow_for_the_weight(
    robot, model, controller
):
    """For a second, in which the stance itself as targets sinks; nobody balances G1 for longer."""
    start = np.concatenate([settled_stand(robot), np.zeros(model.nv)])
    with make_engine(model, controller, (), 1) as engine:

        def heights(actions):
            commands = np.tile(actions.commands(actions.unit(actions.default)), (1, 50, 1))
            return engine.rollout(start, controller.initial_memory(), commands).states[0, :, 2]

        holds = heights(joint_actions(robot, around=holding(robot, model)))
        assert np.abs(holds - start[2]).max() < 0.03
        assert heights(joint_actions(robot)).min() < start[2] - 0.1


@pytest.mark.parametrize(
    ("actions", "count"), [(spot_actions(torso=True), 3), (g1_actions(SIDES), 3)]
)
def test_velocities_of_the_base_are_what_the_builders_say(actions, count):
    assert actions.base.tolist() == [True] * count + [False] * (actions.size - count)


def test_velocities_are_of_the_searched_dimensions_and_not_a_matter_of_names():
    ends = np.array([0.0, -1.0, -1.0]), np.array([0.0, 1.0, 1.0])
    names = ("base_height", "vx", "base_camera")
    actions = ActionSpace(names, *ends, np.zeros(3), lambda action: action, velocities=(0, 1))
    assert actions.base.tolist() == [True, False]
    with pytest.raises(UsageError, match=r"velocities \(3,\) of 3 dimensions"):
        replace(actions, velocities=(3,))
