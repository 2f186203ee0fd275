"""What every engine must do, on Spot walking into a box."""

import _thread
import copy
import threading

import mujoco
import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.model.frames import FrameRef
from sumo_dist.policies.hold import hold_targets
from sumo_dist.rollout import make_engine

ROWS, TICKS = 5, 12


@pytest.fixture
def engine(model, policy, kind, frames):
    with make_engine(model, policy, frames, 2, kind) as engine:
        yield engine


def test_shapes_and_names(engine, kind, model, start, frames, random_commands):
    result = engine.rollout(*start, random_commands(ROWS, TICKS))
    assert result.states.shape == (ROWS, TICKS, model.nq + model.nv)
    assert result.targets.shape == (ROWS, TICKS, model.nu)
    assert result.positions.shape == (ROWS, TICKS, 3, 3)
    assert result.rotations.shape == (ROWS, TICKS, 3, 3, 3)
    assert result.memory.shape == (ROWS, 12)
    assert result.memory.dtype == np.float32
    assert result.valid.all()
    assert engine.frames == frames
    assert engine.name.startswith(kind)
    assert f"mujoco{mujoco.__version__}" in engine.build


def test_follows_a_python_loop(engine, model, policy, start, random_commands, python_loop):
    """Contact amplifies rounding, hence a tolerance that grows; it starts at the network's."""
    state, memory = start
    commands = random_commands(ROWS, 25)
    result = engine.rollout(state, memory, commands)
    deviation = np.empty((ROWS, 25))
    for row in range(ROWS):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = np.split(state, [model.nq])
        expected, _ = python_loop(model, policy, data, memory, commands[row])
        deviation[row] = np.abs(result.states[row, :, : model.nq] - expected[:, : model.nq]).max(-1)
    assert deviation[:, 0].max() < 1e-6
    assert np.median(deviation[:, -1]) < 1e-3
    moved = np.abs(result.states[:, -1, 26:28] - state[26:28]).max()
    assert moved > 0.02  # the box was pushed, so contact was in it


def test_targets_are_those_of_the_state_before_a_step(
    engine, model, policy, start, random_commands
):
    state, memory = start
    commands = random_commands(2, TICKS)
    result = engine.rollout(state, memory, commands)
    for row in range(2):
        before, carried = state, memory
        for tick in range(TICKS):
            qpos, qvel = np.split(before, [model.nq])
            expected, carried = policy.step(qpos, qvel, commands[row, tick], carried)
            np.testing.assert_allclose(result.targets[row, tick], expected, atol=1e-4)
            before = result.states[row, tick]


def test_memory_continues_a_rollout(engine, start, random_commands):
    """Rolling out in two parts ends where one part does; only the warm start is not carried."""
    state, memory = start
    commands = random_commands(1, 10)
    whole = engine.rollout(state, memory, commands)
    half = engine.rollout(state, memory, commands[:, :5])
    rest = engine.rollout(half.states[0, -1], half.memory[0], commands[:, 5:])
    np.testing.assert_allclose(rest.states[0, -1, :26], whole.states[0, -1, :26], atol=1e-3)
    np.testing.assert_allclose(rest.memory[0], whole.memory[0], atol=0.05)


def test_frames_are_of_the_same_instant_as_the_state(engine, model, start, random_commands):
    result = engine.rollout(*start, random_commands(2, TICKS))
    data = mujoco.MjData(model)
    for row, tick in np.ndindex(2, TICKS):
        state = result.states[row, tick]
        data.qpos[:], data.qvel[:] = np.split(state, [model.nq])
        mujoco.mj_forward(model, data)
        box, site, leg = (
            data.body("box"),
            data.site("site_body"),
            data.body("front_right_lower_leg"),
        )
        positions = [box.xpos, site.xpos, leg.xpos]
        rotations = np.reshape([box.xmat, site.xmat, leg.xmat], (3, 3, 3))
        np.testing.assert_array_equal(result.positions[row, tick], positions)
        np.testing.assert_array_equal(result.rotations[row, tick], rotations)


def test_no_frames(model, policy, kind, start, random_commands):
    with make_engine(model, policy, (), 1, kind) as engine:
        assert engine.rollout(*start, random_commands(2, 3)).positions.shape == (2, 3, 0, 3)


def test_physics_only_holds_the_commanded_targets(model, policy, kind, start, frames):
    state, _ = start
    targets = np.tile(state[7:26], (1, 5, 1)) + 0.05
    with make_engine(model, hold_targets(policy.contract), frames, 1, kind) as engine:
        result = engine.rollout(state, np.zeros(0, np.float32), targets)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = np.split(state, [model.nq])
    data.ctrl[:] = targets[0, 0]
    mujoco.mj_step(model, data, nstep=10)
    np.testing.assert_array_equal(result.targets, targets)
    np.testing.assert_array_equal(result.states[0, -1], np.concatenate((data.qpos, data.qvel)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s, m, c: (s[:-1], m, c), r"state has shape \(63,\), not \(64\)"),
        (lambda s, m, c: (s, m[:-1], c), r"memory has shape \(11,\), not \(12\)"),
        (lambda s, m, c: (s, m, c[0]), r"commands has shape \(3, 25\), not \(n, n, 25\)"),
        (lambda s, m, c: (s, m, c[:, :, :-1]), r"commands has shape"),
        (lambda s, m, c: (s, m, c[:0]), r"commands has shape"),
        (lambda s, m, c: (s * np.nan, m, c), "state is not finite"),
        (lambda s, m, c: (s + 1e11, m, c), "state is not finite or beyond"),
        (lambda s, m, c: (s, m + np.inf, c), "memory is not finite"),
        (lambda s, m, c: (s, m, c * np.nan), "commands is not finite"),
    ],
)
def test_refuses_bad_arrays(engine, start, change, message, random_commands):
    with pytest.raises(UsageError, match=message):
        engine.rollout(*change(*start, random_commands(2, 3)))


def test_refuses_what_it_cannot_plan_on(model, policy, kind, frames):
    for frame, message in (
        (FrameRef("geom", "box"), "unknown kind of frame 'geom'; valid: body, site"),
        (FrameRef("body", "crate"), "unknown body 'crate'; valid: arm_link_el0"),
    ):
        with pytest.raises(UsageError, match=message):
            make_engine(model, policy, (frame,), 1, kind)
    with pytest.raises(UsageError, match="threads: 0"):
        make_engine(model, policy, frames, 0, kind)
    for mjcf, message in (
        ('<mujoco><option timestep="0.01"/></mujoco>', "autoreset"),
        ('<mujoco><option timestep="0.03"><flag autoreset="disable"/></option></mujoco>', "0.03 s"),
        (
            '<mujoco><option timestep="0.01"><flag autoreset="disable"/></option></mujoco>',
            "0 actuators, policy 'spot' drives 19",
        ),
    ):
        with pytest.raises(UsageError, match=message):
            make_engine(mujoco.MjModel.from_xml_string(mjcf), policy, (), 1, kind)


def test_unknown_kind(model, policy, frames):
    with pytest.raises(UsageError, match="unknown engine 'gpu'; valid: auto, fallback, native"):
        make_engine(model, policy, frames, 1, "gpu")


def test_keeps_its_own_copy_of_the_model(model, policy, kind, start, frames, random_commands):
    mine = copy.copy(model)
    commands = random_commands(1, 3)
    with make_engine(mine, policy, frames, 1, kind) as engine:
        before = engine.rollout(*start, commands)
        mine.opt.gravity[:] = 0.0
        after = engine.rollout(*start, commands)
    np.testing.assert_array_equal(before.states, after.states)


def test_close_may_be_repeated_and_ends_it(engine, start, random_commands):
    engine.close()
    engine.close()
    with pytest.raises(UsageError, match="closed"):
        engine.rollout(*start, random_commands(1, 1))


def test_survives_an_interrupt(engine, start, random_commands):
    commands = random_commands(16, 75)
    before = engine.rollout(*start, commands)
    timer = threading.Timer(0.02, _thread.interrupt_main)
    with pytest.raises(KeyboardInterrupt):
        timer.start()
        engine.rollout(*start, commands)
        timer.join()
    np.testing.assert_array_equal(engine.rollout(*start, commands).states, before.states)


def test_other_python_threads_run_meanwhile(engine, start, random_commands):
    ran = threading.Event()
    threading.Timer(0.005, ran.set).start()
    engine.rollout(*start, random_commands(16, 50))
    assert ran.is_set()
