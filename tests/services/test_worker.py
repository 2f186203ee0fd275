import re
import time
from dataclasses import asdict, replace

import numpy as np
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.rollout import engine_identity
from sumo_dist.services.worker import Inbox, WorkerOptions, Workshop, unique_name
from sumo_dist.wire.codec import decode, encode
from sumo_dist.wire.keys import checked_name
from sumo_dist.wire.messages import RolloutReply, RolloutRequest


@pytest.fixture(scope="module")
def asked(problem, config):
    knots = np.random.default_rng(0).uniform(-1, 1, (config.rollouts, config.nodes, 9))
    return RolloutRequest(
        run="run",
        worker="w-1",
        number=3,
        iteration=0,
        shard=5,
        start=0,
        task="spot/move_box",
        task_hash=problem.hash,
        build=engine_identity()[1],
        settings=asdict(config),
        state=draw_start(problem.task, seed=2),
        memory=problem.policy.initial_memory(),
        knots=knots.astype(np.float32),
        reply_budget_ms=0.0,
    )


@pytest.fixture(scope="module")
def workshop():
    with Workshop(WorkerOptions(name="w-1")) as workshop:
        yield workshop


@pytest.fixture(scope="module")
def expected(problem, config, asked):
    with problem.engine(1) as engine:
        return Evaluator(problem, engine, config)(asked.state, asked.memory, asked.knots)


def test_costs_are_those_of_one_process(workshop, asked, expected):
    reply, traces = workshop.answer(asked)
    assert np.array_equal(reply.terms, expected.terms)
    assert reply.valid.all()
    assert (reply.worker, reply.shard, reply.number, reply.start) == ("w-1", 5, 3, 0)
    assert reply.refusal == ""
    assert reply.compute_ms > 0
    assert np.array_equal(traces.traces, expected.traces)


def test_a_shard_costs_what_its_rows_cost(workshop, asked, expected):
    reply, _ = workshop.answer(replace(asked, start=4, knots=asked.knots[4:7]))
    assert np.array_equal(reply.terms, expected.terms[4:7])
    assert reply.start == 4


def test_replies_can_travel(workshop, asked):
    for request in (asked, replace(asked, task="spot/none")):
        reply, _ = workshop.answer(request)
        assert decode(RolloutReply, encode(reply)).shard == reply.shard


def test_what_is_asked_again_is_answered_from_memory(workshop, asked):
    first, _ = workshop.answer(asked)
    again, _ = workshop.answer(replace(asked, shard=6))
    assert np.array_equal(again.terms, first.terms)
    assert again.compute_ms == first.compute_ms  # measured once
    assert again.shard == 6


@pytest.mark.parametrize("changed", ["knots", "state"])
def test_the_same_rows_of_the_same_plan_with_another_content_are_not(workshop, asked, changed):
    """Such as from an optimizer that was restarted and makes the plan once more."""
    first, _ = workshop.answer(asked)
    other = replace(asked, **{changed: getattr(asked, changed) * np.float32(0.999)})
    reply, _ = workshop.answer(other)
    assert not np.array_equal(reply.terms, first.terms)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"task": "spot/none"}, "unknown task 'spot/none'; valid: "),
        ({"task_hash": "0123"}, "has hash .*, the optimizer's has 0123: the task's files differ"),
        ({"settings": {"rollouts": 3}}, "planner settings of another version; valid: "),
        ({"knots": np.zeros((2, 5, 9), np.float32)}, "knots have shape"),
        ({"knots": np.zeros((2, 4, 8), np.float32)}, "knots have shape"),
        ({"state": np.zeros(3)}, "state has shape"),
        ({"state": np.full(64, 1e300)}, "state "),
        ({"memory": np.zeros(3, np.float32)}, "memory has shape"),
    ],
)
def test_what_cannot_be_done_is_refused_by_name_and_harms_nothing(
    workshop, asked, expected, change, reason
):
    reply, traces = workshop.answer(replace(asked, **change))
    assert re.search(reason, reply.refusal)
    assert reply.terms.size == reply.valid.size == 0
    assert traces is None
    after, _ = workshop.answer(asked)
    assert np.array_equal(after.terms, expected.terms)


def test_takes_up_another_config_when_asked_to(workshop, asked, config, expected):
    shorter = replace(config, horizon=0.2)
    reply, _ = workshop.answer(replace(asked, settings=asdict(shorter)))
    assert not np.array_equal(reply.terms, expected.terms)
    back, _ = workshop.answer(asked)
    assert np.array_equal(back.terms, expected.terms)


def test_a_default_name_is_unique_on_the_bus():
    assert checked_name("worker", unique_name()) == unique_name()


def starts(inbox):
    """Starts of the requests that are still waiting."""
    found = []
    while (request := inbox.get(timeout=0.0)) is not None:
        found.append((request.run, request.number, request.start))
    return found


@pytest.fixture
def inbox():
    return Inbox()


def test_the_shards_of_one_plan_are_worked_off_in_turn(inbox, asked):
    for start in (0, 4, 8):
        inbox.put(replace(asked, start=start))
    assert starts(inbox) == [("run", 3, 0), ("run", 3, 4), ("run", 3, 8)]


def test_a_newer_plan_drops_the_older_one(inbox, asked):
    inbox.put(replace(asked, number=3))
    inbox.put(replace(asked, number=4, start=8))
    inbox.put(replace(asked, number=3, start=4))
    assert starts(inbox) == [("run", 4, 8)]


def test_a_later_iteration_drops_the_earlier_one(inbox, asked):
    inbox.put(replace(asked, iteration=1))
    inbox.put(replace(asked, iteration=0, start=4))
    assert starts(inbox) == [("run", 3, 0)]


def test_another_run_drops_the_last_one_whatever_its_number(inbox, asked):
    inbox.put(replace(asked, number=90))
    inbox.put(replace(asked, run="next", number=0))
    assert starts(inbox) == [("next", 0, 0)]


def test_a_request_whose_time_is_up_is_not_answered(inbox, asked):
    inbox.put(replace(asked, reply_budget_ms=30.0))
    inbox.put(replace(asked, start=4, reply_budget_ms=5000.0))
    time.sleep(0.05)
    assert starts(inbox) == [("run", 3, 4)]


def test_waits_for_a_request_no_longer_than_told(inbox):
    began = time.monotonic()
    assert inbox.get(timeout=0.1) is None
    assert 0.09 < time.monotonic() - began < 0.5
