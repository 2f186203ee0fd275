"""The closed loop in one process: plan, policy, plant."""

import numpy as np
import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.progress import Progress
from sumo_dist.episode.single import run_single
from sumo_dist.errors import UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.timing import anchor_tick

QUICK = PlannerConfig(rollouts=6, horizon=0.5)


def run(seed=1, time_limit=1.0, planner=QUICK, threads=1, **changes):
    config = EpisodeConfig(
        "spot/move_box", seed=seed, planner=planner, time_limit=time_limit, **changes
    )
    return run_single(config, threads)


def digests(recording):
    return recording.plan_digest, recording.state_digest


@pytest.fixture(scope="module")
def quick():
    recording, _ = run()
    return recording


@pytest.mark.slow
def test_two_seconds_with_default_settings():
    recording, ending = run(time_limit=2.0, planner=PlannerConfig(), threads=2)
    states = np.array(recording.states)
    assert ending.reason == "timeout"
    assert np.isfinite(states).all()
    assert states[:, 2].min() > 0.45  # the base stays up [m]
    base = states[:26, :3]  # the first 0.5 s
    assert np.abs(np.diff(base, axis=0)).max() < 0.02  # per tick [m]: 1 m/s
    assert np.linalg.norm(base[-1] - base[0]) < 0.3
    assert list(recording.plan_numbers) == list(range(40))
    assert list(recording.plan_ticks) == [anchor_tick(number) for number in range(40)]
    assert np.isfinite(recording.costs).all()


def test_the_same_seed_gives_the_same_bits(quick):
    assert digests(run()[0]) == digests(quick)


def test_the_number_of_threads_changes_nothing(quick):
    assert digests(run(threads=3)[0]) == digests(quick)


def test_another_seed_gives_another_run(quick):
    recording, _ = run(seed=2)
    assert not np.array_equal(recording.states[0], quick.states[0])
    assert not set(digests(recording)) & set(digests(quick))


@pytest.mark.parametrize("optimizer", ["mppi", "ps"])
def test_every_optimizer_plans_and_repeats_itself(optimizer, quick):
    planner = PlannerConfig(optimizer, rollouts=6, horizon=0.5)
    recording, _ = run(planner=planner, time_limit=0.5)
    again, _ = run(planner=planner, time_limit=0.5)
    assert digests(recording) == digests(again)
    assert not np.array_equal(recording.knots[-1], quick.knots[len(recording.knots) - 1])


def test_lowpass_estimates_are_acted_on_and_repeat_themselves(quick):
    recording, ending = run(estimator="lowpass")
    assert ending.reason == "timeout"
    states, estimates = np.array(recording.states), np.array(recording.estimates)
    errors = np.abs(states - estimates)[:, :26]  # poses and joints
    assert 0 < errors.max() < 0.1
    assert states[:, 2].min() > 0.4
    assert digests(run(estimator="lowpass")[0]) == digests(recording)
    assert recording.state_digest != quick.state_digest


def test_truth_is_what_the_plant_is_in(quick):
    assert np.array_equal(quick.states, quick.estimates)


@pytest.mark.parametrize("spline", ["zero", "cubic"])
def test_every_spline_can_be_flown(spline):
    recording, ending = run(planner=PlannerConfig(spline=spline, rollouts=6, horizon=0.5))
    assert ending.reason == "timeout"
    assert np.array(recording.states)[:, 2].min() > 0.4


def test_candidates_lost_to_divergence_do_not_stop_the_run():
    """The finest of limits: one rollout an iteration, one node, one tick of horizon."""
    planner = PlannerConfig(rollouts=2, nodes=1, horizon=0.02, iterations=2)
    recording, ending = run(planner=planner, time_limit=0.2)
    assert ending.reason == "timeout"
    assert np.isfinite(np.array(recording.knots)).all()


def test_realtime_needs_workers():
    with pytest.raises(UsageError, match="realtime clock plans asynchronously: it needs at least"):
        run(clock="realtime")


def test_progress_tells_of_the_cost_every_two_seconds():
    lines = []
    config = EpisodeConfig("spot/move_box", seed=1, planner=QUICK, time_limit=2.1)
    run_single(config, 1, Progress(["goal", "gripper", "velocity", "fall"], lines.append))
    assert len(lines) == 2
    assert lines[0].startswith("  0.0 s  cost ")
    assert lines[1].startswith("  2.0 s  cost ")
    assert "goal" in lines[0]
    assert "plan" in lines[0]
