import numpy as np
import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.errors import UsageError
from sumo_dist.learn.recordings import find_recordings, gather
from sumo_dist.math.splines import knot_times
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.observation import Observer
from sumo_dist.record.recording import Recording


def test_examples_are_what_the_planner_saw_and_decided(recorded, problem):
    examples, recording = gather([recorded]), Recording.load(recorded)
    ticks = np.asarray(recording.plan_ticks)
    assert len(examples.observations) == len(ticks)
    parameters = problem.task.table.defaults.parameters
    observer = Observer(problem.task, problem.model)
    seen = observer(np.asarray(recording.estimates)[ticks], parameters)
    np.testing.assert_array_equal(examples.observations, seen)
    np.testing.assert_array_equal(examples.knots, np.asarray(recording.knots)[:, 1:])
    planner = PlannerConfig()
    times = knot_times(planner.spline, planner.nodes, planner.horizon)
    assert examples.contract.times == tuple(times[1:])
    assert examples.tasks == {"spot/move_box": 1}


def test_runs_that_did_not_succeed_are_left_out(recorded, tmp_path):
    failed = Recording.load(recorded)
    failed.ending = "timeout"
    (tmp_path / "failed").mkdir()
    failed.save(tmp_path / "failed/run.npz")
    both = gather([recorded, tmp_path])
    assert both.tasks == {"spot/move_box": 1}
    with pytest.raises(UsageError, match="none of these runs ended in success"):
        gather([tmp_path])


def test_runs_that_need_different_policies_are_refused(recorded, tmp_path):
    config = EpisodeConfig(
        "spot/move_box", planner=PlannerConfig(rollouts=2, horizon=0.4), time_limit=0.1
    )
    other, _ = run_single(config, threads=1)
    other.ending = "success"
    other.save(tmp_path / "run.npz")
    with pytest.raises(UsageError, match=r"differ from that of spot/move_box, in times: "):
        gather([recorded, tmp_path])


def test_a_place_without_recordings_is_named(tmp_path, recorded):
    with pytest.raises(UsageError, match=f"no recording in {tmp_path}"):
        find_recordings([recorded, tmp_path])
