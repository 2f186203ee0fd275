import errno
import io
import tempfile
import tracemalloc

import numpy as np
import pytest

from sumo_dist.record import rows
from sumo_dist.record.rows import Rows


@pytest.fixture(params=[10_000_000, 500], ids=["in memory", "on disk"])
def grown(request, monkeypatch):
    """100 rows of (2, 3), some of them in a file."""
    monkeypatch.setattr(rows, "SPILL_BYTES", request.param)
    expected = np.random.default_rng(0).normal(size=(100, 2, 3))
    return Rows(expected), expected


def test_holds_what_was_appended(grown):
    found, expected = grown
    assert len(found) == 100
    np.testing.assert_array_equal(np.array(found), expected)
    np.testing.assert_array_equal(list(found), expected)
    np.testing.assert_array_equal(found[3:70], expected[3:70])
    for at in (0, 42, 99, -1, -100):
        np.testing.assert_array_equal(found[at], expected[at])
    with pytest.raises(IndexError):
        found[100]


def test_grows_on_after_it_was_read(grown):
    found, expected = grown
    np.array(found)
    for row in expected:
        found.append(row)
    np.testing.assert_array_equal(np.array(found), np.concatenate([expected, expected]))


@pytest.mark.parametrize("shape", [(), (64,)])
def test_memory_stays_as_it_is(monkeypatch, shape):
    monkeypatch.setattr(rows, "SPILL_BYTES", 50_000)
    row, found = np.zeros(shape), Rows()
    tracemalloc.start()
    try:
        for _ in range(20_000):
            found.append(row)
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 100_000


@pytest.mark.parametrize("length", [100, 99, 40, 1])
def test_cut_drops_the_last_rows(grown, length):
    found, expected = grown
    found.cut(length)
    np.testing.assert_array_equal(list(found), expected[:length])
    found.append(expected[0])
    np.testing.assert_array_equal(np.array(found)[-1], expected[0])
    assert len(found) == length + 1


def test_numbers_are_rows_too():
    found = Rows([3, 4, 5])
    assert list(found) == [3, 4, 5]
    assert np.sum(found) == 12
    assert np.array(found).dtype == np.int64


def test_a_row_is_a_copy():
    row = np.zeros(3)
    found = Rows([row])
    row[0] = 1.0
    assert found[0][0] == 0.0


def test_a_row_of_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"shape \(2,\) among rows of shape \(3,\)"):
        Rows([np.zeros(3), np.zeros(2)])


def test_without_rows():
    assert not Rows()
    assert np.array(Rows()).size == 0
    assert list(Rows()) == []


def test_a_full_disk_costs_memory_and_no_rows(monkeypatch):
    def full():
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(rows, "SPILL_BYTES", 500)
    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    expected = np.arange(300.0).reshape(100, 3)
    np.testing.assert_array_equal(np.array(Rows(expected)), expected)


@pytest.mark.parametrize("kind", ["<f4", "<f8", "<i8", "?"])
def test_writes_what_numpy_would(monkeypatch, kind):
    monkeypatch.setattr(rows, "SPILL_BYTES", 500)
    expected = (np.random.default_rng(0).normal(size=(100, 3)) * 9).astype(kind)
    ours, numpys = io.BytesIO(), io.BytesIO()
    Rows(expected).write(ours)
    np.save(numpys, expected)
    assert ours.getvalue() == numpys.getvalue()


def test_no_rows_are_an_empty_array():
    ours, numpys = io.BytesIO(), io.BytesIO()
    Rows().write(ours)
    np.save(numpys, np.array(Rows()))
    assert ours.getvalue() == numpys.getvalue()
    assert np.array(Rows()).shape == (0,)


def test_rows_without_numbers_rest_on_disk_too(monkeypatch):
    monkeypatch.setattr(rows, "SPILL_BYTES", 500)
    found = Rows(np.empty((20, 0)))
    assert np.array(found).shape == (20, 0)
    assert found[3].shape == (0,)
    assert len(list(found)) == 20


def test_reading_and_writing_take_little_memory(monkeypatch, tmp_path):
    monkeypatch.setattr(rows, "SPILL_BYTES", 50_000)
    found = Rows(np.zeros((20_000, 64)))  # 10 MB
    tracemalloc.start()
    try:
        with (tmp_path / "rows.npy").open("wb") as file:
            found.write(file)
        assert sum(1 for _ in found) == 20_000
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 500_000
