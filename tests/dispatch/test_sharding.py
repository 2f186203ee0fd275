import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_dist.dispatch.sharding import split

speeds = st.dictionaries(
    st.text("abcdefgh", min_size=1, max_size=3), st.floats(1e-3, 1e3), min_size=1
)


@given(st.integers(0, 100), st.integers(0, 300), speeds)
def test_every_row_goes_to_exactly_one_worker(start, count, speeds):
    shards = split(start, count, speeds)
    rows = [row for _, first, size in shards for row in range(first, first + size)]
    assert rows == list(range(start, start + count))
    assert len({worker for worker, _, _ in shards}) == len(shards)


@given(st.integers(1, 300), speeds)
def test_shares_are_in_proportion_to_speed(count, speeds):
    got = {worker: size for worker, _, size in split(0, count, speeds)}
    for worker, speed in speeds.items():
        assert got.get(worker, 0) == pytest.approx(count * speed / sum(speeds.values()), abs=1.0001)


def test_a_worker_three_times_as_fast_gets_three_times_as_much():
    assert split(0, 32, {"slow": 1.0, "fast": 3.0}) == [("slow", 0, 8), ("fast", 8, 24)]


def test_idle_workers_get_no_empty_shard():
    assert split(4, 1, {"a": 1.0, "b": 1.0, "c": 1.0}) == [("b", 4, 1)]
