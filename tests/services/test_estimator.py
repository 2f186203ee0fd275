"""The estimator's server: it takes up episodes, and doubts readings of ticks that cannot be."""

import logging

import numpy as np
import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.services.estimator import JUMP, EstimatorServer
from sumo_dist.tasks import load_task
from sumo_dist.wire.messages import EpisodeInfo, Sensors

MODEL = compile_model(load_task("spot/move_box").scene, PLANT)
NONE = np.empty((0, 2)), np.empty((0, 1, 7))


def reading(tick, run="run"):
    stamps = np.empty(0, np.int64)
    truth = np.full(MODEL.nq + MODEL.nv, float(tick % 1000))
    return Sensors(run, tick, truth, stamps, NONE[0], stamps, NONE[1])


def info(run="run", task="spot/move_box", number=1, estimator="truth"):
    return EpisodeInfo(run, EpisodeConfig(task, estimator=estimator).to_json(), "hash", number)


@pytest.fixture
def server():
    return EstimatorServer()


@pytest.fixture
def ask(server):
    """Return a function: the tick of the answer to readings of a tick, None if there is none."""
    server.answer(info())

    def ask(tick, run="run"):
        state = server.answer(reading(tick, run))
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


def test_another_episode_may_begin_anywhere(server, ask):
    assert ask(500) == 500
    assert server.answer(info("other", number=2)) is None
    assert [ask(0, "other"), ask(1, "other")] == [0, 1]
    assert ask(501) is None  # of the episode that is over


def test_readings_of_an_episode_that_nobody_has_told_of_are_not_answered(server):
    assert server.answer(reading(0)) is None
    server.answer(info())
    assert server.answer(reading(0)).tick == 0


def test_an_episode_that_is_told_of_again_goes_on(server, ask):
    """The robot says it once more whenever it repeats a question."""
    assert [ask(tick) for tick in (3, 4)] == [3, 4]
    server.answer(info())
    assert ask(3) is None  # it has not begun again
    assert ask(5) == 5


@pytest.mark.parametrize("task", ["spot/none", "/nowhere/task.py"])
def test_an_episode_that_it_cannot_take_up_is_told_and_the_next_one_is(server, ask, caplog, task):
    with caplog.at_level(logging.ERROR):
        server.answer(info("bad", task, number=2))
    assert [record.levelname for record in caplog.records] == ["ERROR"]
    assert task in caplog.text
    assert ask(0, "bad") is None
    assert server.health()[1]["failures"] == 1
    server.answer(info("next", number=3))
    assert ask(0, "next") == 0


def test_what_is_no_episode_is_told_and_harms_nothing_that_follows(server, ask, caplog):
    server.answer(EpisodeInfo("bad", "{}", "hash", 2))
    assert "an episode of another version" in caplog.text
    server.answer(info("next", number=3))
    assert ask(0, "next") == 0


def test_its_mode_is_the_estimator_of_the_episode(server):
    assert server.health()[0] == "waiting"
    server.answer(info(estimator="lowpass"))
    assert server.health()[0] == "lowpass"


def test_another_task_has_states_of_its_own(server):
    server.answer(info("r.1"))
    assert len(server.answer(reading(0, "r.1")).state) == MODEL.nq + MODEL.nv
    server.answer(info("r.2", "g1/box_push", number=2))
    other = compile_model(load_task("g1/box_push").scene, PLANT)
    stamps = np.empty(0, np.int64)
    truth = np.zeros(other.nq + other.nv)
    state = server.answer(Sensors("r.2", 0, truth, stamps, NONE[0], stamps, NONE[1]))
    assert np.array_equal(state.state, truth)
