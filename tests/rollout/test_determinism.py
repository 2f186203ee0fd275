"""A row's result depends on nothing but its state, memory and commands, bit for bit."""

import dataclasses

import numpy as np
import pytest

from sumo_dist.rollout import make_engine

ROWS, TICKS = 37, 20  # more than one chunk, group and wave; no multiple of any


def assert_same(result, expected, rows=slice(None)):
    for name in (field.name for field in dataclasses.fields(expected)):
        np.testing.assert_array_equal(getattr(result, name), getattr(expected, name)[rows], name)


@pytest.fixture(scope="session")
def commands(random_commands):
    return random_commands(ROWS, TICKS)


@pytest.fixture
def expected(model, policy, kind, start, frames, commands):
    with make_engine(model, policy, frames, 1, kind) as engine:
        return engine.rollout(*start, commands)


@pytest.mark.parametrize("threads", [2, 3, 5])
def test_threads(model, policy, kind, start, expected, threads, frames, commands):
    with make_engine(model, policy, frames, threads, kind) as engine:
        assert_same(engine.rollout(*start, commands), expected)


def test_splits_and_history(model, policy, kind, start, expected, frames, commands):
    """Parts of many sizes, after one another on one engine, the last rows first."""
    sizes = np.array([1, 2, 3, 4, 7, 8, 12])
    assert sizes.sum() == ROWS
    with make_engine(model, policy, frames, 2, kind) as engine:
        for end, size in reversed(list(zip(np.cumsum(sizes), sizes, strict=True))):
            rows = slice(end - size, end)
            assert_same(engine.rollout(*start, commands[rows]), expected, rows)


def test_row_order(model, policy, kind, start, expected, frames, commands):
    order = np.random.default_rng(0).permutation(ROWS)
    with make_engine(model, policy, frames, 2, kind) as engine:
        assert_same(engine.rollout(*start, commands[order]), expected, order)


def test_build_depends_on_nothing_of_the_run(model, policy, kind, frames):
    with (
        make_engine(model, policy, frames, 1, kind) as one,
        make_engine(model, policy, (), 2, kind) as other,
    ):
        assert one.build == other.build
