"""Residuals that tasks share, one number at a time."""

import numpy as np
import pytest

from sumo_dist.costs.parameters import Parameters
from sumo_dist.costs.view import Frame, View
from sumo_dist.math.rotations import from_rotation_vector, matrix
from sumo_dist.robots.g1 import G1
from sumo_dist.robots.spot import SPOT
from sumo_dist.tasks import terms

LEVEL = np.zeros(3)


def frame(name, pos=(0.0, 0.0, 1.0), turn=LEVEL, velocity=(0.0,) * 6):
    rot = matrix(from_rotation_vector(np.array(turn, float)))
    return Frame(
        name, np.array(pos, float)[None, None], rot[None, None], np.array(velocity)[None, None]
    )


def view(*frames, actions=(0.0,) * 9, **parameters):
    named = {each.name: each for each in frames}
    values = {name: np.array(value) for name, value in parameters.items()}
    return View(named, np.array(actions)[None, None], Parameters(values))


def test_distance_is_between_two_frames():
    r = view(frame("a", (1.0, 2.0, 3.0)), frame("b", (1.0, 5.0, 7.0)))
    assert terms.distance("a", "b")(r).tolist() == [[5.0]]


def test_the_distance_to_the_goal_is_on_the_floor_or_in_space():
    r = view(frame("box", (4.0, 0.0, 9.0)), goal=(1.0, 4.0))
    assert terms.goal_distance("box")(r).tolist() == [[5.0]]
    r = view(frame("box", (4.0, 4.0, 9.0)), goal=(1.0, 4.0))
    assert terms.goal_distance("box", 5.0)(r).tolist() == [[5.0]]


def test_speed_and_spin_are_of_a_free_body():
    r = view(frame("box", velocity=[3.0, 0.0, 4.0, 0.0, -2.0, 0.0]))
    assert terms.speed("box")(r).tolist() == [[5.0]]
    assert terms.spin("box")(r).tolist() == [[2.0]]


@pytest.mark.parametrize(("lean", "tilt", "held"), [(0.7, 0.8, False), (0.9, 0.8, True)])
def test_tipped_is_beyond_a_tilt(lean, tilt, held):
    r = view(frame("box", turn=(0.0, lean, 0.0)))
    assert terms.tipped("box", tilt)(r).tolist() == [[held]]
    assert terms.tipped("box")(r).tolist() == [[lean > np.pi / 4]]


@pytest.mark.parametrize(
    ("box", "base", "held"), [(7.0, 1.0, False), (9.0, 1.0, True), (1.0, 9.0, True)]
)
def test_outside_is_one_frame_too_far(box, base, held):
    r = view(frame("box", (box, 0.0, 0.0)), frame("base", (0.0, base, 0.0)))
    assert terms.outside(8.0, "box", "base")(r).tolist() == [[held]]
    assert terms.outside(8.0, "base")(r).tolist() == [[base > 8.0]]


@pytest.mark.parametrize(
    ("height", "turn", "held"),
    [
        (SPOT.fall_height + 0.01, (1.5, 0.0, 0.0), False),
        (SPOT.fall_height - 0.01, (1.5, 0.0, 0.0), True),
        (SPOT.fall_height - 0.01, LEVEL, False),
        (SPOT.fall_height / 2, LEVEL, True),
    ],
)
def test_a_robot_lies_on_its_side_or_very_low(height, turn, held):
    assert terms.lies(SPOT)(view(frame("base", (0, 0, height), turn))).tolist() == [[held]]


def test_a_robot_is_low_at_its_fall_height():
    for above, held in ((0.0, True), (1e-9, False)):
        r = view(frame("base", (0, 0, G1.fall_height + above)))
        assert terms.low(G1)(r).tolist() == [[held]]


def test_effort_is_speed_and_distance_from_standing():
    default = np.array([0.0, 0.0, 0.0, 1.0, 2.0])
    r = view(actions=[3.0, 4.0, 0.0, 1.0, 4.0])
    assert terms.effort(default)(r).tolist() == [[7.0]]
    assert terms.effort(default[:3])(view(actions=[3.0, 4.0, 0.0])).tolist() == [[5.0]]
