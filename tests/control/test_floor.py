import math

import numpy as np
import pytest

from sumo_dist.control.floor import FloorPlan, hull
from sumo_dist.episode.assemble import draw_start
from sumo_dist.errors import UsageError
from sumo_dist.tasks import load_task, task_names


def test_a_hull_goes_round_its_points_counter_clockwise():
    square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    assert hull([*square, [0.5, 0.5], [0.5, 0.0], [1.0, 1.0]]) == square
    assert hull([[2.0, 1.0]]) == [[2.0, 1.0]]
    assert hull([[0.0, 0.0], [1.0, 1.0], [0.5, 0.5]]) == [[0.0, 0.0], [1.0, 1.0]]


def test_a_box_is_where_its_state_says():
    task = load_task("spot/move_box")
    floor, state = FloorPlan(task), draw_start(task, 1)
    assert floor.frames == ["base", "box"]
    x, y, heading = floor.at(state)["places"][1]
    corners = np.array(
        [p for whose, points in floor.at(state)["shapes"] if whose == "thing" for p in points]
    )
    assert np.allclose((corners.min(axis=0) + corners.max(axis=0)) / 2, (x, y), atol=0.01)
    model_state = state.copy()
    box = floor._index.pose("box")
    model_state[box] = [3.0, -2.0, 0.25, math.cos(0.5), 0.0, 0.0, math.sin(0.5)]
    assert floor.at(model_state)["places"][1] == [3.0, -2.0, 1.0]
    assert (x, y, heading) != (3.0, -2.0, 1.0)


@pytest.mark.parametrize("name", task_names())
def test_every_task_has_a_robot_and_things_to_show(name):
    task = load_task(name)
    floor = FloorPlan(task)
    shown = floor.at(draw_start(task, 1))
    assert floor.frames[0] == "base"
    assert len(shown["places"]) == len(floor.frames)
    assert {"robot", "thing"} <= {whose for whose, _ in [*shown["shapes"], *floor.fixed]}
    assert np.isfinite([p for _, points in shown["shapes"] for p in points for p in p]).all()


def test_a_state_of_another_size_is_none_of_its():
    with pytest.raises(UsageError, match="shape"):
        FloorPlan(load_task("spot/move_box")).at(np.zeros(7))
