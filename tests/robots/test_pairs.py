"""What every pair of a robot and a policy must do; add yours to PAIRS."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sumo_dist.episode.safety import sitting_down
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANNING, PLANT, Scene, compile_model
from sumo_dist.model.settle import height_above_floor, settled_stand
from sumo_dist.policies import load_policy
from sumo_dist.robots.compatibility import check
from sumo_dist.robots.g1 import G1, SIDES, g1_actions
from sumo_dist.robots.spot import SPOT, spot_actions
from sumo_dist.rollout import make_controller, make_engine
from sumo_dist.timing import TICK

PAIRS = {
    "spot": (SPOT, "spot", spot_actions()),
    "g1": (G1, "g1", g1_actions(SIDES)),
    "g1-ppo": (G1, "g1-ppo", g1_actions(SIDES)),
}


class Pair:
    """A robot on an empty floor with a policy."""

    def __init__(self, robot, policy, actions):
        self.robot, self.actions = replace(robot, policy=policy), actions
        self.scene = Scene(self.robot, floor_friction=1.0, floor_priority=0)
        self.model = compile_model(self.scene, PLANT)
        self.policy = load_policy(policy)
        self.base = StateIndex(self.model).pose(robot.base)
        self.start = np.concatenate([settled_stand(self.robot), np.zeros(self.model.nv)])
        self.frames = (FrameRef("body", robot.base),)

    def engine(self, kind="auto", threads=1):
        return make_engine(self.model, self.policy, self.frames, threads, kind)

    def walk(self, command, seconds):
        """Follow one command (nc,); the states (T, nq + nv)."""
        commands = np.tile(command, (1, round(seconds / TICK), 1))
        with self.engine() as engine:
            result = engine.rollout(self.start, self.policy.initial_memory(), commands)
        assert result.valid.all()
        return result.states[0]

    def random_commands(self, rows, ticks):
        """Straight ways through half of the action space, (rows, ticks, nc)."""
        ends = np.random.default_rng(1).uniform(-0.5, 0.5, (rows, 2, self.actions.size))
        share = np.linspace(0.0, 1.0, ticks)[:, None]
        return self.actions.commands(ends[:, :1] * (1.0 - share) + ends[:, 1:] * share)


@pytest.fixture(scope="module", params=PAIRS)
def pair(request):
    return Pair(*PAIRS[request.param])


@pytest.mark.parametrize("options", [PLANT, PLANNING])
def test_they_fit(pair, options):
    check(pair.policy.contract, pair.robot, compile_model(pair.scene, options))


def test_the_robot_is_named_completely(pair):
    joints = len(pair.robot.joints)
    assert len(pair.robot.stand) == len(pair.robot.sit) == joints == pair.model.nu
    assert len(pair.robot.default_command) == pair.policy.contract.command_size
    assert pair.policy.initial_memory().shape == (pair.policy.contract.memory_size,)
    low, high = pair.model.jnt_range[1 : joints + 1].T
    for pose in (pair.robot.stand, pair.robot.sit):
        assert (low - 1e-9 <= pose).all()
        assert (pose <= high + 1e-9).all()


def test_the_stance_rests_on_the_floor(pair):
    qpos = pair.start[: pair.model.nq]
    assert abs(height_above_floor(pair.model, qpos, pair.robot.base)) < 1e-6
    assert pair.start[pair.base][2] > pair.robot.fall_height


def test_the_default_command_stands(pair):
    states = pair.walk(np.array(pair.robot.default_command), 3.0)
    heights, ways = states[:, pair.base][:, 2], states[:, pair.base][:, :2]
    assert heights.min() > pair.robot.fall_height
    assert np.linalg.norm(ways, axis=1).max() < 0.15


def test_the_default_action_commands_no_velocity(pair):
    command = pair.actions.commands(pair.actions.unit(pair.actions.default))
    np.testing.assert_array_equal(command[:3], 0.0)


@pytest.mark.parametrize(("axis", "speed"), [(0, 0.5), (1, 0.3), (2, 0.4)])
def test_it_goes_where_it_is_told(pair, axis, speed):
    command = np.array(pair.robot.default_command)
    command[axis] = speed
    states = pair.walk(command, 4.0)
    assert states[:, pair.base][:, 2].min() > pair.robot.fall_height
    w, _, _, z = states[-1, pair.base][3:]
    moved = 2 * np.arctan2(z, w) if axis == 2 else states[-1, pair.base][axis]
    assert 0.4 * speed * 4.0 < moved < 1.4 * speed * 4.0


def test_every_engine_has_the_same_policy(pair):
    rng = np.random.default_rng(0)
    native = make_controller(pair.policy, pair.model)
    memory = pair.policy.initial_memory()
    commands = pair.random_commands(1, 6)[0]
    qpos, qvel = np.split(pair.start, [pair.model.nq])
    for command in commands:
        qpos = qpos + np.where(np.arange(pair.model.nq) < 7, 0.0, rng.normal(0, 0.01, len(qpos)))
        qvel = rng.normal(0, 0.3, pair.model.nv)
        ours, next_memory = native.step(qpos, qvel, command, memory)
        theirs, expected = pair.policy.step(qpos, qvel, command, memory)
        np.testing.assert_allclose(ours, theirs, atol=2e-5)
        np.testing.assert_allclose(next_memory, expected, atol=1e-4)
        memory = next_memory


def test_rows_are_the_same_in_any_split(pair):
    commands, memory = pair.random_commands(7, 10), pair.policy.initial_memory()
    with pair.engine(threads=2) as together, pair.engine(threads=1) as alone:
        whole = together.rollout(pair.start, memory, commands)
        for row in range(7):
            part = alone.rollout(pair.start, memory, commands[row : row + 1])
            np.testing.assert_array_equal(part.states[0], whole.states[row])
            np.testing.assert_array_equal(part.memory[0], whole.memory[row])


def test_the_memory_is_all_there_is(pair):
    """A rollout in two parts ends where one does, but for the solver's warm start."""
    commands, memory = pair.random_commands(1, 40), pair.policy.initial_memory()
    with pair.engine() as engine:
        whole = engine.rollout(pair.start, memory, commands)
        half = engine.rollout(pair.start, memory, commands[:, :20])
        rest = engine.rollout(half.states[0, -1], half.memory[0], commands[:, 20:])
    joints = slice(7, 7 + len(pair.robot.joints))
    np.testing.assert_allclose(rest.states[0, -1, joints], whole.states[0, -1, joints], atol=0.01)


def test_the_safe_stop_comes_to_rest(pair):
    """Ramp to the sitting pose and hold, as the robot does when it has lost its state."""
    data = mujoco.MjData(pair.model)
    data.qpos[:] = pair.start[: pair.model.nq]
    motion = list(sitting_down(pair.robot, np.array(pair.robot.stand)))
    np.testing.assert_allclose(motion[-1], pair.robot.sit)
    for tick in range(round(4.0 / TICK)):
        data.ctrl[:] = motion[min(tick, len(motion) - 1)]
        mujoco.mj_step(pair.model, data, round(TICK / pair.model.opt.timestep))
    assert np.isfinite(data.qpos).all()
    assert np.abs(data.qvel[:3]).max() < 0.1
    assert data.qpos[2] < pair.robot.fall_height
