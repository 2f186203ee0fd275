import json
import re
from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.bench.measure import safety
from sumo_dist.bench.measure.safety import Peaks, Walker, read
from sumo_dist.cli import main
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.errors import UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.robots.g1 import G1

LIMITS = np.array(G1.safety.target_rate)


def no_peaks():
    return Peaks(np.full(29, np.inf), np.full(29, -np.inf), np.zeros(29), np.zeros(29))


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(safety, "WALKS", 1)
    monkeypatch.setattr(safety, "WALK_S", 4.0)


def test_a_walk_is_within_the_limits_and_ends_upright():
    peaks, walker = no_peaks(), Walker("g1")
    states = [state for state, _ in walker.walk(np.random.default_rng(0), peaks)]
    assert len(states) == 2
    assert min(state[2] for state in states) > G1.fall_height
    assert (peaks.commands, peaks.changed) == (200, 0)
    assert (peaks.rate < LIMITS).all()
    assert 1.0 < peaks.speed.max() < G1.safety.joint_speed
    assert (peaks.low < peaks.high).all()


def test_a_stop_is_a_fall_that_comes_to_rest():
    walker = Walker("g1")
    for at in walker.walk(np.random.default_rng(0), no_peaks()):
        stop = walker.stop(*at)
        assert stop["height at the end [m]"] < 0.3
        assert stop["most tilt [deg]"] > 60.0
        assert 0.5 < stop["most speed of the base [m/s]"] < 3.0
        assert 0.5 < stop["at rest after [s]"] < 5.0


def test_a_recorded_run_counts(tmp_path):
    planner = PlannerConfig(rollouts=6, horizon=0.2)
    config = EpisodeConfig("g1/door_open", seed=3, planner=planner, time_limit=0.3)
    recording, _ = run_single(config, threads=1)
    recording.save(tmp_path / "run.npz")
    peaks = no_peaks()
    read(tmp_path, "g1", peaks)
    assert peaks.commands == len(recording.targets)
    np.testing.assert_array_equal(peaks.high, np.max([G1.stand, *recording.targets], axis=0))
    with pytest.raises(UsageError, match=r"run.npz is of g1, not of spot"):
        read(tmp_path, "spot", no_peaks())


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
        (["--seed", "-1"], "seed must not be negative"),
        (["/nowhere"], "no recording at /nowhere/run.npz"),
    ],
)
def test_bad_usage_is_one_line(arguments, reason, capsys):
    assert main(["bench", "safety", *arguments]) == 2
    error = capsys.readouterr().err
    assert re.search(reason, error)
    assert len(error.splitlines()) == 1
