from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.bench.measure.pool_model import (
    Parts,
    RolloutTimes,
    free_messages,
    most_that_fit,
    predict,
    requests,
)

EXACT = RolloutTimes([1, 8], [2.0, 16.0], [[1.0], [1.0]])  # 2 ms a row, always
PARTS = Parts(EXACT, 5.0, 1.0, [1, 2, 101], [0.0, 0.5, 50.0], row_ms=0.0, idle_ms=0.0)


def test_rows_are_shared_out_as_they_are_sent():
    whom, rows = requests(workers=3, rollouts=9, chunk=2)
    assert (whom.tolist(), rows.tolist()) == ([0, 0, 1, 1, 2, 2], [2, 1, 2, 1, 2, 1])
    whom, rows = requests(workers=4, rollouts=2, chunk=None)
    assert len(set(whom.tolist())) == 2 and rows.tolist() == [1, 1]


def test_a_plan_waits_for_the_request_that_leaves_last():
    found = predict(PARTS, workers=4, rollouts=8, given_ms=10.0)
    assert found.p50_ms == pytest.approx(5.0 + 3 * 0.5 + 4.0)
    assert found.p50_ms == found.p99_ms
    assert found.in_time == 6.0  # those that are there after 9.0, 9.5 and 10.0 ms


def test_requests_of_a_worker_queue():
    found = predict(PARTS, workers=1, rollouts=4, given_ms=10.0, chunk=2)
    assert found.p50_ms == pytest.approx(5.0 + 8.0)  # the second is there before the first is done
    assert found.in_time == 2.0


def test_rows_and_idle_workers_cost_what_they_were_measured_to():
    found = predict(replace(PARTS, row_ms=0.1), workers=2, rollouts=8, given_ms=50.0)
    assert found.p50_ms == pytest.approx(5.0 + 0.5 + 6 * 0.1 + 8.0)
    found = predict(replace(PARTS, idle_ms=0.2), workers=10, rollouts=2, given_ms=50.0)
    assert found.p50_ms == pytest.approx(5.0 + 0.5 + 8 * 0.2 + 2.0)


def test_the_slowest_of_many_decides():
    spread = replace(PARTS, rollout=replace(EXACT, factors=[[1.0, 2.0], [1.0, 2.0]]))
    alone = predict(spread, workers=1, rollouts=1, given_ms=8.0)
    assert 0.4 < alone.in_time < 0.6
    many = predict(free_messages(spread), workers=50, rollouts=50, given_ms=8.0)
    assert many.p50_ms == pytest.approx(5.0 + 4.0)
    assert 24.0 < many.in_time < 26.0
    same = replace(spread, rollout=spread.rollout.without_spread())
    assert predict(free_messages(same), 50, 50, 8.0).p50_ms == pytest.approx(5.0 + 2.0)


@pytest.mark.parametrize(("workers", "most"), [(1, 22), (2, 43)])
def test_as_many_fit_as_are_in_time(workers, most):
    # The optimizer has 46 ms, of which 45 are left: for 22.5 rows. The second worker's first
    # request is the fourth that leaves, 1.5 ms after the first: 21.75 rows.
    assert most_that_fit(PARTS, workers, chunk=8) == most


def test_messages_that_take_the_whole_period_leave_no_room():
    dear = replace(PARTS, overhead_ms=[0.0, 40.0, 4000.0])
    assert most_that_fit(dear, 100, chunk=8) < 50
    # 22 a worker, and a few more of which too few are late to count
    assert 2200 <= most_that_fit(free_messages(dear), 100, chunk=8) <= 2222


def test_times_are_medians_on_a_line_and_drawn_as_they_were_measured():
    times = RolloutTimes.of({2: [10.0, 12.0, 11.0], 4: [20.0, 21.0, 25.0]})
    assert times.medians_ms == [11.0, 21.0]
    assert times.median(np.array([1, 2, 3, 4, 6])).tolist() == [11.0, 11.0, 16.0, 21.0, 31.0]
    drawn = times.draw(np.array([4]), 200, np.random.default_rng(1))
    assert set(drawn[:, 0].round(6)) == {20.0, 21.0, 25.0}
    assert times.slowed(2.0).median(np.array([4])).tolist() == [42.0]
    assert RolloutTimes.fixed(7.0).median(np.array([1, 9])).tolist() == [7.0, 7.0]
