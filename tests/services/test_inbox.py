"""In which order a worker answers what it is asked."""

import time
from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.services import inbox as module
from sumo_dist.services.inbox import ROWS, Inbox
from sumo_dist.wire.messages import RolloutRequest


@pytest.fixture
def asked():
    """A request of two rows of a plan."""
    return RolloutRequest(
        *("run", "w-1", "o-1", "spot", 3, 0, 5, 0, "spot/move_box", "ab12", "build", {}),
        *(np.zeros(3), np.zeros(2, np.float32), np.zeros(1), np.zeros((2, 4, 9), np.float32), 0.0),
    )


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


@pytest.mark.alone
def test_waits_for_a_request_no_longer_than_told(inbox):
    began = time.monotonic()
    assert inbox.get(timeout=0.1) is None
    assert 0.09 < time.monotonic() - began < 0.5


def rows(inbox, count):
    """Rows that each asker has got of some requests that are handed out."""
    got = {}
    for _ in range(count):
        request = inbox.get(timeout=0.0)
        got[request.asker] = got.get(request.asker, 0) + len(request.knots)
    return got


def test_askers_get_the_same_number_of_rows_whatever_the_size_of_their_requests(inbox, asked):
    small, large = asked, replace(asked, knots=np.zeros((8, 4, 9), np.float32))
    for start in range(40):
        inbox.put(replace(small, asker="small", start=start))
    for start in range(10):
        inbox.put(replace(large, asker="large", start=start))
    got = rows(inbox, 25)
    assert abs(got["small"] - got["large"]) <= 8


def test_who_has_asked_for_nothing_has_saved_up_nothing(inbox, asked):
    for start in range(20):
        inbox.put(replace(asked, asker="busy", start=start))
    rows(inbox, 10)
    for start in range(20):
        inbox.put(replace(asked, asker="late", start=start))
    got = rows(inbox, 10)
    assert abs(got["busy"] - got["late"]) <= 2


def test_plans_that_are_given_up_cost_their_asker_nothing(inbox, asked):
    for number in range(50):
        inbox.put(replace(asked, asker="hasty", number=number))
    inbox.put(replace(asked, asker="calm"))
    assert rows(inbox, 2) == {"hasty": 2, "calm": 2}


@pytest.mark.parametrize("before", [0, 1])
def test_a_request_of_too_many_rows_is_dropped_and_others_are_answered(inbox, asked, before):
    """Alone, and for a newer plan than what its asker waits for."""
    huge = replace(asked, number=9, knots=np.zeros((ROWS + 1, 4, 9), np.float32))
    for _ in range(before):
        inbox.put(asked)
    inbox.put(huge)
    assert inbox.get(timeout=0.0) is None
    inbox.put(replace(asked, asker="other"))
    assert inbox.get(timeout=0.0).asker == "other"


def test_what_has_a_deadline_goes_first(inbox, asked):
    for start in range(3):
        inbox.put(replace(asked, asker="lockstep", start=start))
    inbox.put(replace(asked, asker="realtime", reply_budget_ms=10_000.0))
    assert inbox.get(timeout=0.0).asker == "realtime"
    assert inbox.get(timeout=0.0).asker == "lockstep"


def test_a_higher_priority_goes_first_but_for_deadlines(inbox, asked):
    inbox.put(replace(asked, asker="low", priority=-1))
    inbox.put(replace(asked, asker="usual"))
    inbox.put(replace(asked, asker="high", priority=2))
    inbox.put(replace(asked, asker="due", priority=-9, reply_budget_ms=10_000.0))
    assert [inbox.get(0.0).asker for _ in range(4)] == ["due", "high", "usual", "low"]


@pytest.mark.parametrize("sizes", [(1, 1), (1, 8), (3, 5)])
def test_two_robots_of_equal_load_have_shares_within_a_tenth(inbox, asked, sizes):
    """Whatever the size of their requests, plan after plan."""
    got = [0, 0]
    for number in range(20):
        for asker, size in enumerate(sizes):
            knots = np.zeros((size, 4, 9), np.float32)
            for start in range(0, 120, size):
                request = replace(asked, asker=f"o-{asker}", number=number, knots=knots)
                inbox.put(replace(request, start=start))
        rows = 0
        while rows < 100:  # before the next plans of both come
            request = inbox.get(0.0)
            rows += len(request.knots)
            got[int(request.asker[-1])] += len(request.knots)
    assert abs(got[0] - got[1]) <= 0.1 * sum(got) / 2


def test_what_waits_is_bounded(inbox, asked):
    for start in range(module.ROWS):
        inbox.put(replace(asked, start=2 * start))
    assert len(starts(inbox)) == module.ROWS // 2
    inbox.put(asked)
    assert len(starts(inbox)) == 1


def test_askers_are_bounded(inbox, asked, monkeypatch):
    for asker in range(module.ASKERS + 5):
        inbox.put(replace(asked, asker=f"o-{asker}"))
    assert len(starts(inbox)) == module.ASKERS
    monkeypatch.setattr(module, "REMEMBERED_S", 0.0)
    inbox.put(replace(asked, asker="late"))
    assert len(starts(inbox)) == 1
