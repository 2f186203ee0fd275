"""Any more success is worth more than any time; what a search came to follows from its rows."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_dist.bench.tune.results import COMPLETE, PRUNED, best, loss, progress, tried

LIMIT = 30.0


def row(time, limit=LIMIT):
    """Of an episode that was solved at a time [s], or not."""
    return {"success": time is not None, "completion_time_s": time, "time_limit_s": limit}


def journal(*trials):
    """Rows of trials, each (times, state), one after the other."""
    found = []
    for number, (times, state) in enumerate(trials):
        for i, time in enumerate(times):
            about = {"trial": number, "values": {"x": number}, "cpu_s": 2.0, "seed": i}
            now = state if i == len(times) - 1 else "running"
            found.append({**row(time), **about, "state": now})
    return found


TIMES = st.one_of(st.none(), st.floats(0.02, LIMIT))


@given(st.lists(st.tuples(TIMES, TIMES), min_size=1, max_size=8))
def test_success_comes_before_time(pairs):
    one, other = ([row(time) for time in times] for times in zip(*pairs, strict=True))
    solved = [sum(r["success"] for r in rows) for rows in (one, other)]
    if solved[0] > solved[1]:
        assert loss(one) <= loss(other)  # equal at most where all took the whole time
    assert len(one) - solved[0] <= loss(one) <= len(one) - solved[0] + 1


def test_of_equal_success_the_faster_is_better():
    assert loss([row(3.0), row(None)]) < loss([row(None), row(3.1)])
    assert loss([row(3.0), row(9.0)]) == pytest.approx(12 / 60)
    assert loss([row(None), row(None)]) == 3.0


def test_the_best_is_complete_and_the_first_of_equals():
    trials = tried(
        journal(
            ((9.0, 9.0), COMPLETE), ((1.0,), PRUNED), ((6.0, 6.0), COMPLETE), ((6.0, 6.0), COMPLETE)
        )
    )
    assert [trial.number for trial in trials] == [0, 1, 2, 3]
    winner = best(trials)
    assert winner is not None and winner.number == 2
    assert best(trials[1:2]) is None
    assert [(s, t.number) for s, t in progress(trials)] == [(4.0, 0), (10.0, 2)]
