"""The estimator's desk, and readings that cannot be of the tick they claim."""

import time

import numpy as np
import pytest

from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.services.estimator import JUMP, Desk
from sumo_dist.tasks import load_task
from sumo_dist.wire.messages import Sensors

MODEL = compile_model(load_task("spot/move_box").scene, PLANT)
NONE = np.empty((0, 2)), np.empty((0, 1, 7))


def reading(tick, run="run"):
    stamps = np.empty(0, np.int64)
    truth = np.full(MODEL.nq + MODEL.nv, float(tick % 1000))
    return Sensors(run, tick, truth, stamps, NONE[0], stamps, NONE[1])


@pytest.fixture
def ask():
    """Return a function: the tick of the answer to readings of a tick, None if there is none."""
    desk = Desk("truth", MODEL)

    def ask(tick, run="run"):
        state = desk.answer(reading(tick, run))
        return None if state is None else state.tick

    return ask


def test_readings_are_answered_in_order_and_again(ask):
    assert [ask(tick) for tick in (0, 1, 1, 3, 2, 3)] == [0, 1, 1, 3, None, 3]


@pytest.mark.parametrize("lie", [2**53, JUMP + 10])
def test_one_reading_of_a_far_tick_does_not_keep_out_those_that_follow(ask, lie):
    assert [ask(tick) for tick in (1, 2, lie, 3, 4, lie, 5)] == [1, 2, None, 3, 4, None, 5]


def test_a_first_reading_that_lies_is_forgotten_after_two_others(ask):
    assert [ask(tick) for tick in (2**53, 1, 2, 3)] == [2**53, None, 2, 3]


def test_a_gap_in_the_readings_costs_one_of_them(ask):
    assert [ask(tick) for tick in (1, 200, 201, 202)] == [1, None, 201, 202]


def test_another_run_may_begin_anywhere(ask):
    assert [ask(500), ask(0, "other"), ask(1, "other")] == [500, 0, 1]


def test_a_robot_that_is_started_again_and_asks_too_soon_is_answered_in_the_end(ask, monkeypatch):
    now = [10.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    assert [ask(tick) for tick in (0, 1, 2)] == [0, 1, 2]
    answers = []
    for _ in range(4):  # it asks every quarter of a second
        now[0] += 0.2
        answers.append(ask(0))
    assert answers == [None, None, 0, 0]
    assert ask(1) == 1
