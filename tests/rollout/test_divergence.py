"""Rows that leave the numbers' range are marked and stopped; their neighbours do not notice."""

import mujoco
import numpy as np
import pytest

from sumo_dist.model.frames import FrameRef
from sumo_dist.policies import PolicyContract
from sumo_dist.policies.hold import hold_targets
from sumo_dist.robots.spot import SPOT
from sumo_dist.rollout import make_engine

SLIDER = """
<mujoco>
  <option timestep="0.01"><flag autoreset="disable"/></option>
  <worldbody>
    <body name="slider"><joint name="slide" type="slide"/><geom size="0.1" mass="1"/></body>
  </worldbody>
  <actuator><motor joint="slide" gear="1e6"/></actuator>
</mujoco>
"""
FRAMES = (FrameRef("body", "slider"),)


@pytest.fixture
def engine(kind):
    contract = PolicyContract("slider", 50.0, ("slide",), (0.0,), (0.0,), 1, 0, 0, 0, "")
    model = mujoco.MjModel.from_xml_string(SLIDER)
    with make_engine(model, hold_targets(contract), FRAMES, 2, kind) as engine:
        yield engine


def roll_out(engine, forces):
    commands = np.array(forces, float)[:, :, None]
    return engine.rollout(np.zeros(2), np.zeros(0, np.float32), commands)


@pytest.mark.parametrize("tick", [0, 2, 5])
def test_diverged_row_is_marked_from_its_step_on(engine, tick, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    forces = np.tile([1e-6, 2e-6, 3e-6], (6, 1)).T
    healthy = roll_out(engine, forces)
    forces[1, tick] = 1e9  # an acceleration of 1e15
    result = roll_out(engine, forces)
    assert result.valid.tolist() == [True, False, True]
    for name in ("states", "targets", "positions", "rotations"):
        array, expected = getattr(result, name), getattr(healthy, name)
        np.testing.assert_array_equal(array[[0, 2]], expected[[0, 2]])
        np.testing.assert_array_equal(array[1, :tick], expected[1, :tick])
        assert np.isnan(array[1, tick:]).all()
    assert not list(tmp_path.iterdir())  # MuJoCo would log every divergence to a file


def test_leaving_the_range_gradually_is_divergence_too(engine):
    """Every acceleration is legal; the velocity it adds up to is not."""
    result = roll_out(engine, np.full((1, 100), 9e3))
    assert not result.valid[0]
    speeds = result.states[0, np.isfinite(result.states[0, :, 1]), 1]
    assert 9.8e9 < speeds[-1] <= 1e10


def test_engine_recovers(engine):
    forces = np.full((4, 3), 1e-6)
    healthy = roll_out(engine, forces)
    assert not roll_out(engine, np.full((4, 3), 1e9)).valid.any()
    np.testing.assert_array_equal(roll_out(engine, forces).states, healthy.states)


def test_a_policy_network_survives_the_divergence_of_all_its_rows(model, policy, start, kind):
    """With nobody left there is nothing to evaluate: the rollout ends, and the engine goes on."""
    state, memory = start
    wild = state.copy()
    wild[model.nq :] = 1e6  # [m/s], [rad/s]
    commands = np.tile(SPOT.default_command, (3, 5, 1))
    with make_engine(model, policy, (FrameRef("body", "box"),), 1, kind) as engine:
        assert not engine.rollout(wild, memory, commands).valid.any()
        assert engine.rollout(state, memory, commands).valid.all()
