"""The policy's native twin against numpy, and both against the engine that rolls it out."""

import time

import numpy as np
import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.policies.hold import hold_targets
from sumo_dist.robots.spot import SPOT
from sumo_dist.rollout import make_controller, make_engine


@pytest.fixture
def controller(policy, model, kind):
    return make_controller(policy, model, kind)


def random_inputs(seed, model):
    rng = np.random.default_rng(seed)
    qpos = rng.normal(size=model.nq)
    qpos[3:7] /= np.linalg.norm(qpos[3:7])
    command = rng.normal(size=25)
    command[10:22] = np.repeat(rng.integers(0, 2, 4), 3) * rng.integers(0, 2, 12) * command[10:22]
    return qpos, rng.normal(size=model.nv), command, rng.normal(size=12).astype(np.float32)


def test_agrees_with_numpy(controller, policy, model):
    np.testing.assert_array_equal(controller.initial_memory(), policy.initial_memory())
    for seed in range(50):
        inputs = random_inputs(seed, model)
        targets, memory = controller.step(*inputs)
        expected_targets, expected_memory = policy.step(*inputs)
        scale = np.abs(expected_memory).max()
        np.testing.assert_allclose(memory, expected_memory, atol=2e-6 * scale)
        np.testing.assert_allclose(targets, expected_targets, atol=0.2 * 2e-6 * scale)
        assert memory.dtype == np.float32


def test_arguments_are_left_alone(controller, model):
    inputs = random_inputs(0, model)
    before = [array.copy() for array in inputs]
    controller.step(*inputs)
    for array, old in zip(inputs, before, strict=True):
        np.testing.assert_array_equal(array, old)


@pytest.mark.parametrize("legs", [(0,), (3,), (0, 1), (1, 2), (0, 1, 2, 3)])
def test_every_commanded_leg_is_overridden(controller, model, legs):
    """One non-zero value commands its whole leg: the other two targets are then 0 rad."""
    qpos, qvel, _, memory = random_inputs(0, model)
    command = np.array(SPOT.default_command)
    free, _ = controller.step(qpos, qvel, command, memory)
    for leg in legs:
        command[10 + 3 * leg + 1] = 0.4
    targets, _ = controller.step(qpos, qvel, command, memory)
    for leg in range(4):
        joints = slice(3 * leg, 3 * leg + 3)
        if leg in legs:
            np.testing.assert_array_equal(targets[joints], [0.0, 0.4, 0.0])
        else:
            assert not np.isin(targets[joints], [0.0, 0.4]).any()
    np.testing.assert_array_equal(targets[12:], command[3:10])
    np.testing.assert_array_equal(free[12:], command[3:10])


def test_engine_runs_the_same_policy(controller, policy, model, kind, start, random_commands):
    """One step's memory is the last action: equal to the bit."""
    state, memory = start
    commands = random_commands(9, 1)
    with make_engine(model, policy, (), 2, kind) as engine:
        result = engine.rollout(state, memory, commands)
    qpos, qvel = np.split(state, [model.nq])
    for row in range(len(commands)):
        _, following = controller.step(qpos, qvel, commands[row, 0], memory)
        np.testing.assert_array_equal(result.memory[row], following)


def test_physics_only(policy, model, kind):
    controller = make_controller(hold_targets(policy.contract), model, kind)
    command = np.arange(19.0)
    targets, memory = controller.step(
        np.zeros(33), np.zeros(31), command, controller.initial_memory()
    )
    np.testing.assert_array_equal(targets, command)
    assert memory.shape == (0,)


def test_refuses_wrong_shapes(controller, model):
    qpos, qvel, command, memory = random_inputs(0, model)
    with pytest.raises(SumoError, match=r"\(24,\)"):
        controller.step(qpos, qvel, command[:-1], memory)
    with pytest.raises(SumoError, match=r"\(11,\)"):
        controller.step(qpos, qvel, command, memory[:-1])


def test_unknown_kind(policy, model):
    with pytest.raises(UsageError, match="unknown engine 'gpu'; valid: auto, fallback, native"):
        make_controller(policy, model, "gpu")


@pytest.mark.parametrize("engine", ["native", "native-portable"])
def test_one_row_is_cheap(policy, model, start, engine):
    """A kernel whose accumulators spill is slower than numpy's 16 padded rows, not 10x faster."""
    pytest.importorskip("sumo_dist.rollout._native", reason="not compiled here")
    state, memory = start
    inputs = (*np.split(state, [model.nq]), np.array(SPOT.default_command), memory)

    def fastest(controller):
        times = []
        for _ in range(50):
            began = time.perf_counter()
            controller.step(*inputs)
            times.append(time.perf_counter() - began)
        return min(times)

    assert fastest(make_controller(policy, model, engine)) < fastest(policy)
