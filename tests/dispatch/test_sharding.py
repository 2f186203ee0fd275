import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_dist.dispatch.pace import Pace
from sumo_dist.dispatch.sharding import chunk, split

names = st.text("abcdefgh", min_size=1, max_size=3)
speeds = st.floats(1e-3, 1e3)
paces = st.dictionaries(
    names, st.builds(Pace, speeds, st.floats(0.0, 1e3), st.integers(1, 9)), min_size=1
)


@given(st.integers(0, 100), st.integers(0, 300), paces)
def test_every_row_goes_to_exactly_one_worker(start, count, paces):
    shards = split(start, count, paces)
    rows = [row for _, first, size in shards for row in range(first, first + size)]
    assert rows == list(range(start, start + count))
    assert len({worker for worker, _, _ in shards}) == len(shards)


@given(st.integers(1, 100), st.lists(speeds, min_size=1, max_size=8))
def test_shares_are_in_proportion_to_speed(count, speeds):
    paces = {f"w-{i}": Pace(speed) for i, speed in enumerate(speeds)}
    got = {worker: size for worker, _, size in split(0, count, paces)}
    for worker, pace in paces.items():
        share = count * pace.rows_per_ms / sum(speeds)
        assert share - 1.001 < got.get(worker, 0) < share + len(paces)


@given(st.integers(1, 100), paces)
def test_nobody_would_be_ready_sooner_with_rows_of_who_ends_last(count, paces):
    got = {worker: size for worker, _, size in split(0, count, paces)}
    last = max(paces[worker].ready_ms(size) for worker, size in got.items())
    for worker, pace in paces.items():
        assert pace.ready_ms(got.get(worker, 0) + pace.threads) >= last * (1 - 1e-9)


def test_a_worker_three_times_as_fast_gets_three_times_as_much():
    paces = {"slow": Pace(1.0), "fast": Pace(3.0)}
    assert split(0, 32, paces) == [("slow", 0, 8), ("fast", 8, 24)]


def test_a_worker_far_away_gets_what_is_back_when_the_others_are_ready():
    paces = {"near": Pace(1.0), "far": Pace(1.0, wait_ms=10.0)}
    assert split(0, 30, paces) == [("near", 0, 20), ("far", 20, 10)]
    assert split(0, 8, paces) == [("near", 0, 8)]


def test_rows_fill_a_workers_threads():
    paces = {"one": Pace(1.0), "eight": Pace(8.0, threads=8)}
    shards = split(0, 36, paces)
    assert shards == [("one", 0, 4), ("eight", 4, 32)]


def test_idle_workers_get_no_empty_shard():
    assert len(split(4, 1, {"a": Pace(1.0), "b": Pace(1.0), "c": Pace(1.0)})) == 1


@pytest.mark.parametrize(
    ("pace", "rows"),
    [(Pace(1.0), 10), (Pace(0.01), 1), (Pace(1.0, threads=4), 8), (Pace(0.1, 0.0, 4), 4)],
)
def test_a_request_is_a_part_of_what_fits_and_fills_the_threads(pace, rows):
    assert chunk(pace, budget_ms=40.0, requests=4) == rows
