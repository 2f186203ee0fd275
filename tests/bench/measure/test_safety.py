import json
import re
from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.bench.measure import safety
from sumo_dist.bench.measure.safety import Walker
from sumo_dist.cli import main
from sumo_dist.robots.g1 import G1


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(safety, "WALKS", 1)
    monkeypatch.setattr(safety, "WALK_S", 4.0)


@pytest.fixture(scope="module")
def walker():
    return Walker("g1")


def test_a_walk_is_within_the_limits_and_ends_upright(walker):
    walked = [(state, guard) for state, guard in walker.walk(np.random.default_rng(0))]
    assert len(walked) == 2
    assert min(state[2] for state, _ in walked) > G1.fall_height
    assert sum(walked[-1][1].changed.values()) == 0


def test_a_stop_is_a_fall_that_comes_to_rest(walker):
    for state, guard in walker.walk(np.random.default_rng(0)):
        stop = walker.stop(state, guard.last)
        assert stop["height at the end [m]"] < 0.3
        assert stop["most tilt [deg]"] > 60.0
        assert 0.5 < stop["most speed of the base [m/s]"] < 3.0
        assert 0.5 < stop["at rest after [s]"] < 5.0


@pytest.mark.parametrize("robot", ["g1", "spot"])
def test_the_command(robot, capsys):
    assert main(["bench", "safety", "--robot", robot, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["commands"], result["changed"], len(result["stops"])) == (200, 0, 2)


def test_a_command_that_the_guard_changes_fails_it(monkeypatch, capsys):
    scene, actions = safety.ROBOTS["g1"]
    tight = replace(G1, safety=replace(G1.safety, target_rate=(2.0,) * 29))
    monkeypatch.setitem(safety.ROBOTS, "g1", (replace(scene, robot=tight), actions))
    assert main(["bench", "safety", "--robot", "g1"]) == 1
    assert re.search(r"200 commands, [1-9]\d* changed", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--robot", "g2"], "unknown robot 'g2'; valid: .*g1"),
        (["--seed", "-1"], "seed must be at least 0"),
    ],
)
def test_bad_usage_is_one_line(arguments, reason, capsys):
    assert main(["bench", "safety", *arguments]) == 2
    error = capsys.readouterr().err
    assert re.search(reason, error)
    assert len(error.splitlines()) == 1
