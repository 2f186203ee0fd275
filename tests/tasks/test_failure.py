"""What an episode that runs out of time is put down to."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.episode.ending import End, Ending
from sumo_dist.episode.referee import Referee
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.tasks import load_task

LAST = 1500  # the tick at which time is up


@pytest.fixture(scope="module")
def cone():
    return load_task("spot/move_cone")


@pytest.fixture(scope="module")
def model(cone):
    return compile_model(cone.scene, PLANT)


@pytest.fixture
def lying(cone, model):
    """A start with the cone on its side."""
    state = draw_start(cone, 1)
    state[StateIndex(model).pose("cone")][2:] = [0.19, np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]
    return state


def test_it_is_named_when_time_is_up_and_not_before(cone, model, lying):
    referee = Referee(cone, model)
    assert referee.verdict(LAST - 1, lying) is None
    assert referee.verdict(LAST, lying) == Ending(End.FAILURE, "tipped")
    assert referee.verdict(LAST, draw_start(cone, 1)) == Ending(End.TIMEOUT)


def test_the_first_of_two_is_named(cone, model, lying):
    far = lying.copy()
    far[StateIndex(model).pose("cone")][0] = 9.0
    assert Referee(cone, model).verdict(LAST, far).reason == "tipped"
    only_left = replace(cone, failure={"left": cone.failure["left the workspace"]})
    assert Referee(only_left, model).verdict(LAST, far).reason == "left"


def test_success_comes_first(cone, model, lying):
    solved = replace(cone, success=lambda r: np.ones((1, 1), bool))
    assert Referee(solved, model).verdict(LAST, lying) == Ending(End.SUCCESS)
