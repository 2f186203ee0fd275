import json

import numpy as np
import pytest

from sumo_dist.bench.measure import policy
from sumo_dist.bench.measure.policy import STEADY, Walker, steady, wander, wave
from sumo_dist.cli import main
from sumo_dist.robots.g1 import BASE_LIMITS, G1


@pytest.fixture(scope="module")
def walker():
    return Walker("g1", "auto")


def test_steady_commands_reach_every_limit():
    assert len(STEADY) == 12
    assert (np.abs(STEADY).max(axis=0) == BASE_LIMITS).all()
    commands = steady(STEADY, 0.1)
    assert commands.shape == (12, 5, 19)
    assert (commands[:, 0, :3] == STEADY).all()


def test_random_commands_change_and_stay_within_the_limits():
    commands = wander(np.random.default_rng(0), 4, 12.0)
    assert (np.abs(commands[..., :3]) <= BASE_LIMITS).all()
    assert len(np.unique(commands[0, :, 0])) == 4
    assert not commands[..., 17:].any()


def test_arms_are_moved_by_up_to_1_rad_from_the_stance():
    commands = wave(np.random.default_rng(0), 5, 10.0)
    off = commands[..., 3:17] - np.array(G1.default_command)[3:17]
    assert (commands[..., 17:] == 1.0).all()
    np.testing.assert_allclose(off[:, 0], 0.0, atol=1e-12)
    assert 0.9 < np.abs(off).max() <= 1.0 + 1e-12
    assert not off[..., [4, 5, 6, 11, 12, 13]].any()  # wrists


def test_falls_are_counted_and_nan_is_one(walker):
    states = walker.walk(steady(np.zeros((3, 3)), 0.2))
    assert walker.falls(states) == 0
    states[0, 3, 2], states[2, 9:] = 0.6, np.nan
    assert walker.falls(states) == 2


def test_the_command(monkeypatch, capsys):
    monkeypatch.setattr(policy, "LONG_S", 0.4)
    monkeypatch.setattr(policy, "ARMS_S", 0.4)
    assert main(["bench", "policy", "--policy", "g1-ppo", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [(run["runs"], run["falls"]) for run in result["runs"]] == [(12, 0), (8, 0), (40, 0)]
    assert main(["bench", "policy", "--policy", "spot"]) == 2
    assert "unknown policy 'spot'; valid: g1, g1-ppo" in capsys.readouterr().err
