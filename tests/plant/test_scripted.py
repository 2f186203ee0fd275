"""A body whose motion is given."""

import numpy as np
import pytest

from sumo_dist.estimate import make_estimator
from sumo_dist.plant.body import Body
from sumo_dist.plant.scripted import ScriptedBody
from sumo_dist.robots.spot import SPOT

STAND = np.array(SPOT.stand)


@pytest.fixture
def states(first_state):
    return [first_state + 0.001 * tick for tick in range(4)]


def test_plays_its_states_and_the_last_one_for_ever(states, go, plant):
    body: Body = ScriptedBody(states)
    estimate = make_estimator("truth", plant.model)
    for tick in range(7):
        assert body.tick == tick
        expected = states[min(tick, 3)]
        assert np.array_equal(body.truth, expected)
        assert np.array_equal(estimate(body.read()), expected)
        go(body, STAND)


def test_keeps_what_it_was_told_and_does_as_it_likes(states, go):
    body, targets = ScriptedBody(states), STAND.copy()
    go(body, targets)
    targets += 1.0
    go(body, targets)
    assert np.array_equal(body.sent, [STAND, STAND + 1.0])
    assert np.array_equal(body.truth, states[2])


def test_a_body_may_not_know_its_state(states):
    body = ScriptedBody(states, knows_truth=False)
    assert body.truth is None
    assert np.array_equal(body.read().truth, states[0])
