"""The lean planning model on every engine: contacts from a list, whose friction varies by row."""

import numpy as np
import pytest

from sumo_dist.model.scene import PLANNING, compile_model
from sumo_dist.model.variation import Spread, draw, varied
from sumo_dist.rollout import make_engine
from sumo_dist.tasks import load_task

ROWS, TICKS = 6, 20


@pytest.fixture(scope="module")
def lean():
    model = compile_model(load_task("spot/move_box").scene, PLANNING)
    assert model.npair > 0
    return model


def test_engines_agree(lean, policy, kind, frames, start, random_commands):
    """Contact amplifies rounding: a tolerance that grows, from that of the network."""
    commands = random_commands(ROWS, TICKS)
    results = []
    for each in (kind, "fallback"):
        with make_engine(lean, policy, frames, 2, each) as engine:
            results.append(engine.rollout(*start, commands))
    apart = np.abs(results[0].states - results[1].states)[..., : lean.nq].max(axis=(0, 2))
    assert apart[0] < 1e-6
    assert np.median(apart) < 1e-2
    moved = np.abs(results[0].states[:, -1, 26:28] - start[0][26:28]).max()
    assert moved > 0.005  # the box was pushed


def test_a_row_on_a_slippery_variation_is_that_models_rollout(
    lean, policy, kind, frames, start, random_commands
):
    commands = random_commands(ROWS, TICKS)
    variation = draw(lean, Spread(friction=0.6), np.random.default_rng(0))
    models = np.arange(ROWS) % 2
    with make_engine(lean, policy, frames, 2, kind, [variation]) as engine:
        mixed = engine.rollout(*start, commands, models)
    for chosen, model in enumerate((lean, varied(lean, variation))):
        with make_engine(model, policy, frames, 1, kind) as engine:
            alone = engine.rollout(*start, commands)
        np.testing.assert_array_equal(mixed.states[chosen::2], alone.states[chosen::2])
    with make_engine(lean, policy, frames, 1, kind) as engine:
        assert not np.array_equal(engine.rollout(*start, commands).states[1::2], mixed.states[1::2])
