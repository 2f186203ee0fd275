from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sumo_dist.episode.ending import End, Ending
from sumo_dist.episode.referee import Referee
from sumo_dist.model.index import StateIndex


@pytest.fixture
def index(plant):
    return StateIndex(plant.model)


@pytest.fixture
def referee(move_box, plant):
    return Referee(move_box, plant.model)


@pytest.fixture
def at_goal(first_state, index):
    """A state with the robot far away and the box at rest on its goal."""
    state = first_state.copy()
    state[index.pose("body")][:2] = 3.0, 3.0
    state[index.pose("box")][:3] = 0.0, 0.0, 0.254
    return state


def test_an_episode_goes_on_while_nothing_is_decided(referee, first_state):
    assert [referee.verdict(tick, first_state) for tick in range(3)] == [None] * 3


def test_a_box_at_rest_on_its_goal_is_success(referee, at_goal):
    assert referee.verdict(0, at_goal) == Ending(End.SUCCESS)


def test_a_box_that_passes_its_goal_is_not(referee, at_goal, index):
    at_goal[index.velocity("box")][0] = 0.2
    assert referee.verdict(0, at_goal) is None


def test_success_that_must_hold_is_held_without_a_break(move_box, plant, at_goal, index):
    referee = Referee(replace(move_box, success_hold=0.1), plant.model)  # 5 ticks
    moving = at_goal.copy()
    moving[index.velocity("box")][0] = 0.2
    assert [referee.verdict(tick, at_goal) for tick in range(5)] == [None] * 5
    assert referee.verdict(5, moving) is None
    assert [referee.verdict(tick, at_goal) for tick in range(6, 11)] == [None] * 5
    assert referee.verdict(11, at_goal) == Ending(End.SUCCESS)


FELL = Ending(End.FELL)
SIDE, LEVEL = [np.cos(0.6), np.sin(0.6), 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]  # rolled by 69 degrees


@pytest.mark.parametrize(
    ("height", "attitude", "verdict"),
    [(0.36, SIDE, None), (0.3, SIDE, FELL), (0.3, LEVEL, None), (0.1, LEVEL, FELL)],
)
def test_a_robot_that_stays_down_fell(referee, first_state, index, height, attitude, verdict):
    state = first_state.copy()
    state[index.pose("body")][2:] = height, *attitude
    assert [referee.verdict(tick, state) for tick in range(50)] == [None] * 50  # one second
    assert referee.verdict(50, state) == verdict


def test_a_robot_that_comes_up_again_has_not_fallen(referee, first_state, index):
    low = first_state.copy()
    low[index.pose("body")][2] = 0.1
    for tick in range(0, 90, 45):
        assert [referee.verdict(tick, low) for _ in range(45)] == [None] * 45
        assert referee.verdict(tick + 45, first_state) is None


@pytest.mark.parametrize(("limit", "last"), [(None, 1500), (2.0, 100)])
def test_time_runs_out_on_the_tasks_or_the_given_limit(move_box, plant, first_state, limit, last):
    referee = Referee(move_box, plant.model, limit)
    assert referee.verdict(last - 1, first_state) is None
    assert referee.verdict(last, first_state) == Ending(End.TIMEOUT)


def test_success_on_the_last_tick_counts(referee, at_goal):
    assert referee.verdict(1500, at_goal) == Ending(End.SUCCESS)


def test_success_is_at_the_goal_of_the_moment(referee, move_box, at_goal, index):
    """A goal that moves makes what was solved unsolved, and what was not solved."""
    there = at_goal.copy()
    there[index.pose("box")][:2] = 1.0, -1.0
    assert referee.verdict(0, there) is None
    table = move_box.table
    referee.parameters = table.with_parameter(table.defaults, "goal", (1.0, -1.0)).parameters
    assert referee.verdict(1, at_goal) is None
    assert referee.verdict(2, there) == Ending(End.SUCCESS)


def test_a_failure_of_the_tasks_is_named_when_time_is_up(move_box, plant, first_state, index):
    far = first_state.copy()
    far[index.pose("box")][0] = 8.1
    referee = Referee(move_box, plant.model, 1.0)
    assert referee.verdict(49, far) is None
    assert referee.verdict(50, far) == Ending(End.FAILURE, "left the workspace")


def test_sees_the_frames_where_the_simulation_has_them(referee, plant, first_state):
    data = mujoco.MjData(plant.model)
    data.qpos[:] = first_state[: plant.model.nq]
    mujoco.mj_forward(plant.model, data)
    view = referee.view(first_state)
    assert np.allclose(view.gripper.pos[0, 0], data.site("site_arm_link_fngr").xpos)
    assert np.allclose(view.base.rot[0, 0].ravel(), data.body("body").xmat)
    assert view.actions.shape == (1, 1, 9)
