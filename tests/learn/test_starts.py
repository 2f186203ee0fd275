from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.learn.starts import Starts
from sumo_dist.model.variation import Spread, draw


@pytest.fixture(scope="module")
def models(problem):
    one = draw(problem.model, Spread(), np.random.default_rng(0))
    bigger = np.where(problem.model.body_rootid == problem.model.body("box").id, 1.5, 1.0)
    return (replace(one, size=bigger),)


def test_starts_are_those_of_runs_and_objects_rest_on_the_floor(problem, models):
    parameters = problem.task.table.defaults.parameters
    starts = Starts(problem, range(3, 6), parameters, models)
    states, numbers = starts.draw(40, np.random.default_rng(0))
    assert set(numbers) == {0, 1}
    of_runs = np.array([draw_start(problem.task, seed) for seed in (3, 4, 5)])
    height = 28  # of the box
    for state, number in zip(states, numbers, strict=True):
        same = [np.array_equal(np.delete(state, height), np.delete(s, height)) for s in of_runs]
        assert sum(same) == 1
        assert state[height] == pytest.approx((1.0, 1.5)[number] * 0.254, abs=1e-6)


def test_a_draw_leaves_the_store_as_it_was(problem, models):
    starts = Starts(problem, range(1), problem.task.table.defaults.parameters, models)
    first, _ = starts.draw(8, np.random.default_rng(0))
    first[:] = np.nan
    again, _ = starts.draw(8, np.random.default_rng(0))
    assert np.isfinite(again).all()


def test_scattered_starts_are_moved_as_a_whole(problem):
    parameters = problem.task.table.defaults.parameters
    states, _ = Starts(problem, range(1), parameters, (), scatter=2.0).draw(
        50, np.random.default_rng(0)
    )
    start = draw_start(problem.task, 0)
    moved = states - start
    robot, box = moved[:, :2], moved[:, 26:28]
    np.testing.assert_allclose(robot, box)
    assert np.abs(robot).max() <= 2.0
    assert robot.std(axis=0).min() > 0.8
    rest = np.delete(moved, [0, 1, 26, 27], axis=1)
    np.testing.assert_array_equal(rest, 0.0)
