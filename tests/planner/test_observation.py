"""What a learned policy sees: the same wherever the scene lies, and whoever is beside it."""

import numpy as np
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.math.rotations import from_rotation_vector, multiply, rotate
from sumo_dist.model.index import StateIndex
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.observation import Observer
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.tasks import load_task


def observed(task):
    """Return a task, its model and its observer."""
    problem = Problem.build(load_task(task), planning_options(PlannerConfig()))
    return problem.task, problem.model, Observer(problem.task, problem.model)


def usual(task):
    return task.table.named(task.table.defaults.parameters)


@pytest.fixture(scope="module")
def move():
    task, model, observe = observed("spot/move_box")
    return task, StateIndex(model), observe


def moving(task, index, seed):
    """A start in which everything moves."""
    state = draw_start(task, seed).copy()
    state[index.nq :] = np.random.default_rng(seed).uniform(-1.0, 1.0, index.nv)
    return state


def elsewhere(state, index, angle, shift):
    """The same scene, turned about the world's z axis, then shifted on the floor."""
    turn, moved = from_rotation_vector(np.array([0.0, 0.0, angle])), state.copy()
    for body in index.free_bodies:
        pose, velocity = index.pose(body), index.velocity(body)
        position, quat = state[pose][:3], state[pose][3:]
        moved[pose] = np.concatenate([rotate(turn, position) + shift, multiply(turn, quat)])
        moved[velocity][:3] = rotate(turn, state[velocity][:3])
    return moved


@pytest.mark.parametrize("angle", [0.4, 2.0, -3.0])
def test_a_scene_looks_the_same_wherever_it_lies(move, angle):
    task, index, observe = move
    state, shift, goal = (
        moving(task, index, seed=3),
        np.array([1.5, -0.7, 0.0]),
        np.array([0.8, 2.0, 0.0]),
    )
    there = rotate(from_rotation_vector(np.array([0.0, 0.0, angle])), goal) + shift

    def seen(state, goal):
        text = f"goal={float(goal[0])!r},{float(goal[1])!r}"
        parameters = task.table.adjusted([], [text]).parameters
        return observe(state[None], task.table.named(parameters))[0]

    before = seen(state, goal)
    assert np.abs(before[-4:-2]).max() > 0.1
    assert seen(elsewhere(state, index, angle, shift), there) == pytest.approx(before, abs=1e-5)
    assert seen(state, there) != pytest.approx(before, abs=0.1)


def test_a_row_does_not_depend_on_the_others(move):
    task, index, observe = move
    states = np.stack([moving(task, index, seed) for seed in range(5)])
    together = observe(states, usual(task))
    assert (together.dtype, together.shape) == (np.float32, (5, observe.size))
    for state, row in zip(states, together, strict=True):
        assert np.array_equal(observe(state[None], usual(task))[0], row)


def test_what_has_no_goal_sees_none(move):
    task, _, observe = observed("spot/upright_box")
    assert observe.parts == move[2].parts  # so the same policy can do both
    row = observe(draw_start(task, 1)[None], usual(task))[0]
    assert np.array_equal(row[-4:], np.zeros(4))
    task, _, observe = move
    row = observe(draw_start(task, 1)[None], usual(task))[0]
    assert row[-1] == 1.0


def test_parts_follow_robot_and_scene():
    _, _, observe = observed("g1/door_open")
    assert "object 0" not in observe.parts
    assert observe.parts["hinges"] % 3 == 0
    assert observe.size == sum(observe.parts.values())
    _, _, observe = observed("spot/move_cone")
    assert observe.parts["joints"] == observe.parts["joint speeds"] == 19
    assert observe.parts["object 0"] == 15 and observe.parts["goal"] == 4
