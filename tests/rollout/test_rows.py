"""Rows with a start, a memory and a model of their own: each as if it were rolled out alone."""

import dataclasses
from collections import deque

import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.model.variation import Spread, draw, varied
from sumo_dist.rollout import make_engine

ROWS, TICKS = 37, 12  # more than one chunk, group and wave; no multiple of any
SPREAD = Spread(mass=0.3, inertia=0.3, friction=0.5, stiffness=0.2, damping=0.2)
LAST = 3  # number of variations


@pytest.fixture(scope="module")
def variations(model):
    return [draw(model, SPREAD, np.random.default_rng(seed)) for seed in range(LAST)]


@pytest.fixture(scope="module")
def rows(model, start, random_commands):
    """States (B, nq + nv), memories, commands and models of B different rows."""
    rng = np.random.default_rng(1)
    states, memories = (np.tile(part, (ROWS, 1)) for part in start)
    states[:, :2] += rng.uniform(-0.1, 0.1, (ROWS, 2))
    states[:, 7 : model.nq] += rng.normal(0.0, 0.01, (ROWS, model.nq - 7))
    states[:, model.nq :] += rng.normal(0.0, 0.1, (ROWS, model.nv))
    memories += rng.normal(0.0, 0.1, memories.shape).astype(np.float32)
    return states, memories, random_commands(ROWS, TICKS), rng.integers(0, LAST + 1, ROWS)


@pytest.fixture
def engine(model, policy, kind, frames, variations):
    with make_engine(model, policy, frames, 2, kind, variations) as engine:
        yield engine


def assert_same(result, expected, rows=slice(None)):
    for name in (field.name for field in dataclasses.fields(expected)):
        np.testing.assert_array_equal(getattr(result, name), getattr(expected, name)[rows], name)


def test_a_row_of_its_own_start_is_the_rollout_from_there(engine, rows):
    states, memories, commands, _ = rows
    whole = engine.rollout(states, memories, commands)
    assert whole.valid.all()
    for row in range(ROWS):
        alone = engine.rollout(states[row], memories[row], commands[row : row + 1])
        assert_same(alone, whole, slice(row, row + 1))


def test_equal_starts_are_a_shared_start(engine, rows):
    states, memories, commands, _ = rows
    shared = engine.rollout(states[0], memories[0], commands)
    for state in (states[0], np.tile(states[0], (ROWS, 1))):
        for memory in (memories[0], np.tile(memories[0], (ROWS, 1))):
            assert_same(engine.rollout(state, memory, commands), shared)


@pytest.mark.parametrize("threads", [1, 3])
def test_a_row_on_a_variation_is_that_models_rollout(
    model, policy, kind, frames, variations, rows, threads
):
    """Of an engine that knows no other model, whatever ran before in the same simulation."""
    states, memories, commands, models = rows
    with make_engine(model, policy, frames, threads, kind, variations) as engine:
        mixed = engine.rollout(states, memories, commands, models)
    for chosen in range(LAST + 1):
        alone = varied(model, variations[chosen - 1]) if chosen else model
        of_it = np.flatnonzero(models == chosen)
        assert len(of_it) > 1
        with make_engine(alone, policy, frames, 1, kind) as engine:
            result = engine.rollout(states[of_it], memories[of_it], commands[of_it])
        assert_same(result, mixed, of_it)


def test_neighbours_and_history_do_not_matter(engine, rows):
    states, memories, commands, models = rows
    expected = engine.rollout(states, memories, commands, models)
    order = np.random.default_rng(0).permutation(ROWS)
    parts = deque(np.split(order, [1, 3, 6, 10, 17, 25]))
    while parts:
        part = parts.pop()
        result = engine.rollout(states[part], memories[part], commands[part], models[part])
        assert_same(result, expected, part)


def test_variations_of_one_start_part_ways(engine, start, random_commands):
    commands = np.tile(random_commands(1, 25), (LAST + 1, 1, 1))
    states = engine.rollout(*start, commands, np.arange(LAST + 1)).states
    for one, other in zip(*np.triu_indices(LAST + 1, 1), strict=True):
        assert np.abs(states[one, -1] - states[other, -1]).max() > 1e-3


def test_the_model_itself_is_the_default(engine, model, policy, kind, frames, rows):
    states, memories, commands, _ = rows
    with make_engine(model, policy, frames, 2, kind) as plain:
        expected = plain.rollout(states, memories, commands)
        assert_same(plain.rollout(states, memories, commands, np.zeros(ROWS, int)), expected)
    engine.rollout(states, memories, commands, np.full(ROWS, LAST))
    assert_same(engine.rollout(states, memories, commands), expected)


def test_a_row_that_diverges_leaves_the_others_alone(engine, model, rows):
    states, memories, commands, models = rows
    expected = engine.rollout(states, memories, commands, models)
    wild = states.copy()
    wild[5::9, model.nq :] = 1e6  # [m/s], [rad/s]
    result = engine.rollout(wild, memories, commands, models)
    assert np.flatnonzero(~result.valid).tolist() == list(range(5, ROWS, 9))
    assert np.isnan(result.states[5, -1]).all()
    healthy = np.flatnonzero(result.valid)
    assert_same(
        dataclasses.replace(
            result, **{f.name: getattr(result, f.name)[healthy] for f in dataclasses.fields(result)}
        ),
        expected,
        healthy,
    )
    assert_same(engine.rollout(states, memories, commands, models), expected)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s, m, i: (s[1:], m, i), r"state has shape \(36, 64\), not \(64\) or \(37, 64\)"),
        (lambda s, m, i: (s[:1], m, i), r"state has shape \(1, 64\)"),
        (lambda s, m, i: (s[:, 1:], m, i), r"state has shape \(37, 63\)"),
        (lambda s, m, i: (s, m[1:], i), r"memory has shape \(36, 12\), not \(12\) or \(37, 12\)"),
        (lambda s, m, i: (s * np.nan, m, i), "state is not finite"),
        (lambda s, m, i: (s, m, i[1:]), r"models has shape \(36,\) of int64, not \(37,\) of int"),
        (lambda s, m, i: (s, m, i * 1.0), r"models has shape \(37,\) of float64"),
        (lambda s, m, i: (s, m, i > 0), r"models has shape \(37,\) of bool"),
        (lambda s, m, i: (s, m, i + 1), "no model 4; valid: 0, the model itself, to 3"),
        (lambda s, m, i: (s, m, i - 1), "no model -1; valid: 0"),
        (lambda s, m, i: (s, m, np.full(ROWS, 2**32)), "no model 4294967296"),
    ],
)
def test_refuses_rows_that_do_not_fit(engine, rows, change, message):
    states, memories, commands, models = rows
    changed_states, changed_memories, changed_models = change(states, memories, models)
    with pytest.raises(UsageError, match=message):
        engine.rollout(changed_states, changed_memories, commands, changed_models)


def test_an_engine_without_variations_has_one_model(model, policy, kind, start, random_commands):
    with (
        make_engine(model, policy, (), 1, kind) as engine,
        pytest.raises(UsageError, match="no model 1; valid: 0, the model itself, to 0"),
    ):
        engine.rollout(*start, random_commands(2, 2), np.array([0, 1]))


def test_refuses_a_variation_of_another_model(model, policy, kind, variations):
    other = dataclasses.replace(variations[0], mass=np.ones(3))
    with pytest.raises(UsageError, match=r"mass has shape \(3,\)"):
        make_engine(model, policy, (), 1, kind, [other])
