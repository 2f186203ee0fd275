from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode import motion
from sumo_dist.episode.motion import Changes, Differences, measure
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.record.recording import Recording
from sumo_dist.record.rows import Rows
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK

TASK = load_task("spot/move_box")


@pytest.fixture(scope="module")
def model():
    return compile_model(TASK.scene, PLANT)


def count(signal, least=0.0):
    changes = Changes(np.array([least]))
    for value in signal:
        changes.add(np.array([value]))
    return changes.reversals[0]


def test_a_reversal_is_a_change_of_direction():
    assert count([0, 1, 2, 3]) == 0
    assert count([0, 1, 0, 1]) == 2
    assert count([0, 1, 1, 1, 0]) == 1  # it waits in between
    assert count([0, 1, 1, 2]) == 0
    assert count([0, 1, 1 - 1e-9, 2], least=1e-6) == 0


def test_differences_of_a_cubic_are_constant():
    third, second = Differences(3), Differences(2)
    for i in range(9):
        third.add(np.array([i**3, 2.0 * i**3]))
        second.add(np.array([i**2, i**2]))
    assert third.rms() == pytest.approx(6 * np.sqrt(2.5))
    assert third.rms(np.array([True, False])) == pytest.approx(6)
    assert second.rms() == pytest.approx(2)


def test_too_few_values_have_no_differences():
    short = Differences(3)
    for i in range(3):
        short.add(np.array([float(i)]))
    assert np.isnan(short.rms())


def test_a_run_is_measured_and_the_measure_is_kept(short_run, model, tmp_path):
    assert set(short_run.motion) == set(motion.MEASURES)
    short_run.save(tmp_path / "run.npz")
    assert Recording.load(tmp_path / "run.npz").motion == short_run.motion
    assert len(short_run.actions) == len(short_run.states) - 1  # none follows the last state
    assert short_run.motion["floor_penetration_mm"] > 0


def test_the_base_and_the_limbs_are_told_apart(short_run, model):
    shaken = replace(short_run, actions=Rows())
    for i in range(101):
        action = TASK.actions.default.copy()
        action[TASK.actions.velocities[0]] = 0.1 * (i % 2)
        action[len(TASK.actions.velocities)] = 0.1 * (i // 25 % 2)
        shaken.actions.append(action)
    found = measure(shaken, TASK, model)
    base, limbs = len(TASK.actions.velocities), len(TASK.actions.names) - 3
    assert found["base_reversals_hz"] == pytest.approx(99 / (101 * TICK) / base, rel=1e-3)
    assert found["limb_reversals_worst_hz"] == pytest.approx(3 / (101 * TICK), rel=1e-3)
    assert found["limb_reversals_hz"] == pytest.approx(3 / (101 * TICK) / limbs, abs=1e-3)


def test_a_robot_that_is_let_into_the_floor_is_that_deep(short_run, model):
    robot = TASK.scene.robot
    deep = replace(short_run, states=Rows())
    for state in short_run.states:
        sunk = state.copy()
        sunk[2] -= 0.03  # the base is the first free joint
        deep.states.append(sunk)
    before, after = short_run.motion, measure(deep, TASK, model)
    assert model.body(robot.base).jntadr[0] == 0
    sinks = after["floor_penetration_mm"] - before["floor_penetration_mm"]
    assert sinks == pytest.approx(30, abs=3)


@pytest.mark.parametrize(("task", "arms"), [("spot/move_box", 6), ("g1/box_push", 8)])
def test_limb_jerk_is_of_the_joints_that_follow_a_target(task, arms):
    assert motion._followers(load_task(task)).sum() == arms


def test_shaking_a_leg_is_no_limb_jerk(short_run, model):
    shaken = replace(short_run, states=Rows())
    for i, state in enumerate(short_run.states):
        turned = state.copy()
        turned[model.nq + model.joint("fl_kn").dofadr[0]] += 20.0 * (i % 2)
        shaken.states.append(turned)
    before, after = short_run.motion, measure(shaken, TASK, model)
    assert after["limb_jerk"] == before["limb_jerk"] > 0
    assert after["joint_jerk"] > 2 * before["joint_jerk"]


def test_standing_still_is_no_work(short_run, model):
    still = replace(short_run, states=Rows(), targets=Rows())
    for state, targets in zip(short_run.states, short_run.targets, strict=False):
        rest = state.copy()
        rest[model.nq :] = 0
        still.states.append(rest)
        still.targets.append(targets)
    found = measure(still, TASK, model)
    assert found["work_j"] == found["joint_jerk"] == 0


def test_of_a_long_episode_some_poses_are_looked_at(short_run, model, monkeypatch):
    monkeypatch.setattr(motion, "POSES", 5)
    few = measure(short_run, TASK, model)
    assert few["work_j"] == pytest.approx(short_run.motion["work_j"], rel=1.0)
    assert few["limb_reversals_hz"] == short_run.motion["limb_reversals_hz"]


def test_an_episode_without_a_tick_has_no_motion(model):
    assert measure(Recording({}), TASK, model) == {}


def test_means_leave_out_what_has_no_measure():
    rows = [{"work_j": 1.0}, {"work_j": 3.0, "joint_jerk": 5.0}, {}]
    assert motion.mean(rows) == {"work_j": 2.0, "joint_jerk": 5.0}
