"""Spot's moves by joint targets: the cost of the move, and of a trot, against the robot's model."""

import mujoco
import numpy as np
import pytest

from sumo_dist.costs.view import ViewLayout
from sumo_dist.episode.assemble import draw_start
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.tasks import load_task
from sumo_dist.tasks.spot import end_to_end
from sumo_dist.tasks.spot.end_to_end import BEARING, CADENCE, END_TO_END, FOOT_RADIUS, SWING, lift
from sumo_dist.tasks.success import AllBelow

SECOND = round(1.0 / PLANT.timestep)  # steps of the plant


@pytest.fixture(scope="module")
def task():
    return load_task("spot/joints_move_box")


@pytest.fixture(scope="module")
def model(task):
    return compile_model(task.scene, PLANT)


@pytest.fixture
def data(task, model):
    """The start of an episode, the servos at the targets that bear the stance."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = StateIndex(model).unpack(draw_start(task, 0))
    data.ctrl[:] = BEARING
    mujoco.mj_forward(model, data)
    return data


def seen(task, model, data, *param):
    """What residuals see of a simulation's present."""
    parameters = task.table.named(task.table.adjusted((), param).parameters)
    return ViewLayout(model, task.frames).at(data, len(task.actions.names), parameters)


@pytest.mark.parametrize("name", END_TO_END)
def test_the_cost_and_the_test_are_the_moves_and_those_of_a_gait(name):
    task, move = load_task(name), load_task(name.replace("joints_", ""))
    moves = {term.name: (term.weight, term.reduction) for term in move.cost}
    found = {term.name: (term.weight, term.reduction) for term in task.cost}
    gait = [term.name for term in end_to_end.LOCOMOTION]
    assert {name: found[name] for name in moves} == moves
    assert [*found] == [*moves, *gait]
    assert gait == ["upright", "height", "gait", "balance", "effort", "posture"]
    assert isinstance(task.success, AllBelow) and isinstance(move.success, AllBelow)
    assert [m.name for m in task.success.measures] == [m.name for m in move.success.measures]
    assert (task.time_limit, task.planner["rate"]) == (move.time_limit, 50)
    start, same = draw_start(task, 3), draw_start(move, 3)
    np.testing.assert_array_equal(start[: len(same) // 2], same[: len(same) // 2])


def test_all_joints_but_the_gripper_are_searched(task):
    assert task.controller == "joint-targets"
    assert task.actions.names == task.scene.robot.joints[:-1]
    assert task.actions.to_command(task.actions.default)[-1] == 0.0


def test_the_targets_bear_the_stance_for_a_second(model, data):
    height = data.qpos[2]
    for _ in range(SECOND):
        mujoco.mj_step(model, data)
        assert abs(data.qpos[2] - height) < 0.03


def test_the_metronome_keeps_its_time_in_air(model, data):
    mujoco.mj_step(model, data, 10 * SECOND)
    assert data.joint(end_to_end.PHASE).qpos[0] / (2 * np.pi) == pytest.approx(10 * CADENCE)


def test_a_stance_costs_little_but_for_the_steps_that_are_due(task, model, data):
    r = seen(task, model, data)
    assert end_to_end.upright(r) == pytest.approx(0.0, abs=1e-4)
    assert end_to_end.height(r) == pytest.approx(0.0, abs=1e-3)
    assert end_to_end.balance(r) < 0.02
    assert end_to_end.posture(r) < 0.01
    assert 0.01 < end_to_end.gait(r) < 0.2


def test_the_centre_of_mass_of_the_stance_is_where_the_balance_has_it(model, data):
    ahead = data.body("body").xmat.reshape(3, 3).T @ (
        data.subtree_com[model.body("body").id] - data.body("body").xpos
    )
    assert ahead[0] == pytest.approx(end_to_end.MASS_AHEAD, abs=0.005)
    assert abs(ahead[1]) < 0.005


def test_torques_are_the_servos(task, model, data):
    data.qvel[6:18] = np.random.default_rng(0).normal(0.0, 0.5, 12)
    mujoco.mj_forward(model, data)
    torques = end_to_end.torques(seen(task, model, data))
    np.testing.assert_allclose(torques[0, 0], data.actuator_force[:12], atol=1e-9)
    expected = 0.5 * np.sum((data.actuator_force[:12] / 100.0) ** 2)
    assert end_to_end.effort(seen(task, model, data)) == pytest.approx(expected)


def test_diagonal_feet_swing_together_and_for_more_than_half_of_a_step():
    phases = np.linspace(0.0, 2 * np.pi, 1000, endpoint=False)
    lifts = {foot: lift(phases, swing) for foot, swing in SWING.items()}
    np.testing.assert_array_equal(lifts["front_left"], lifts["rear_right"])
    np.testing.assert_array_equal(lifts["front_right"], lifts["rear_left"])
    for foot, swing in SWING.items():
        assert lifts[foot].max() == pytest.approx(1.0, abs=1e-4)
        top = np.array(2 * np.pi * swing)
        assert lift(top, swing) == pytest.approx(1.0)
        assert lift(top + np.pi, swing) == pytest.approx(0.0)
        assert (lifts[foot] > 1e-6).mean() == pytest.approx(1.0 - end_to_end.DUTY, abs=0.003)
        np.testing.assert_allclose(lift(phases + 40 * np.pi, swing), lifts[foot], atol=1e-9)


@pytest.mark.parametrize("phase", [0.0, 0.7, 2.0, 3.5, 60.0])
def test_feet_at_the_heights_of_the_gait_cost_nothing(task, model, data, phase):
    data.joint(end_to_end.PHASE).qpos[0] = phase
    r = seen(task, model, data, "step_height=0.1")
    for foot, swing in SWING.items():
        r[foot].pos[..., 2] = FOOT_RADIUS + 0.1 * lift(np.array(phase), swing)
    assert end_to_end.gait(r) == pytest.approx(0.0, abs=1e-12)
    raised = max(SWING, key=lambda foot: lift(np.array(phase), SWING[foot]))
    r[raised].pos[..., 2] += 0.04
    assert end_to_end.gait(r) == pytest.approx(0.05 - 0.03)  # |0.04| rounded within 0.03
