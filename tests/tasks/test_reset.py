import numpy as np
import pytest

from sumo_dist.errors import SumoError
from sumo_dist.robots.spot import SPOT
from sumo_dist.tasks.reset import Start, redraw

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def start(move_box):
    return Start.of(move_box.scene)


def test_places_the_robot_with_its_stance_height_and_heading(start, index):
    state = start.place(np.array([1.0, -2.0]), np.pi / 2, {})
    base = state[index.pose("body")]
    assert base[:2].tolist() == [1.0, -2.0]
    assert base[2] == start.stance[2]
    assert base[3:] == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    positions, _ = index.joints(SPOT.joints)
    assert state[positions] == pytest.approx(SPOT.stand)


def test_places_objects_and_leaves_all_at_rest(start, index):
    state = start.place(np.zeros(2), 0.0, {"box": (np.array([3.0, 0.0, 0.3]), UPRIGHT)})
    assert state[index.pose("box")].tolist() == [3.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]
    assert not state[index.nq :].any()


@pytest.mark.parametrize(("x", "touching"), [(3.0, False), (0.5, True), (0.0, True)])
def test_touching_is_between_the_robot_and_the_object(start, x, touching):
    state = start.place(np.zeros(2), 0.0, {"box": (np.array([x, 0.0, 0.3]), UPRIGHT)})
    assert start.touching(state, "box") is touching


def test_the_floor_is_not_the_object(start):
    state = start.place(np.zeros(2), 0.0, {"box": (np.array([3.0, 0.0, 0.2]), UPRIGHT)})
    assert not start.touching(state, "box")


def test_redraws_until_accepted():
    draws = iter(range(100))
    assert redraw(lambda: np.array([next(draws)]), lambda state: state[0] >= 7)[0] == 7


def test_a_start_that_cannot_be_reached_is_an_error_and_no_hang():
    with pytest.raises(SumoError, match="no acceptable reset in 1000 draws"):
        redraw(lambda: np.zeros(1), lambda state: False)
