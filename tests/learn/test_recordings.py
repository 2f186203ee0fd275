import numpy as np
import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.errors import UsageError
from sumo_dist.learn.recordings import FORESIGHT, carried_out, cost_to_come, find_recordings, gather
from sumo_dist.math.splines import knot_times
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.observation import Observer
from sumo_dist.record.recording import Recording
from sumo_dist.record.rows import Rows


def test_examples_are_what_the_planner_saw_and_decided(recorded, problem):
    examples, recording = gather([recorded]), Recording.load(recorded)
    ticks = np.asarray(recording.plan_ticks)
    assert len(examples.observations) == len(ticks)
    parameters = problem.task.table.named(problem.task.table.defaults.parameters)
    observer = Observer(problem.task, problem.model)
    seen = observer(np.asarray(recording.estimates)[ticks], parameters)
    np.testing.assert_array_equal(examples.observations, seen)
    done = np.asarray(recording.knots, np.float32)[:, 1]  # at the plans' starts
    np.testing.assert_array_equal(examples.knots[:, 0], done)
    last = np.broadcast_to(done[-1], examples.knots[:, 1:].shape)  # it was too short for later ones
    np.testing.assert_array_equal(examples.knots[:, 1:], last)
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


def test_a_knot_is_what_was_done_when_its_time_came():
    ticks, now = np.array([0, 2, 5, 7, 10]), np.arange(5.0)[:, None]  # at 20 plans a second
    done = carried_out(ticks, now, (0.0, 0.06, 0.1, 0.5))[..., 0]
    np.testing.assert_array_equal(done[0], [0.0, 1.0, 2.0, 4.0])
    np.testing.assert_array_equal(done[:, 0], now[:, 0])
    np.testing.assert_array_equal(done[3], [3.0, 4.0, 4.0, 4.0])


def test_the_cost_to_come_is_that_of_the_plans_from_horizon_to_horizon():
    costs = np.array([8.0, 6.0, 4.0, 2.0])  # at 2 plans a second, each for a second
    kept = np.exp(-1.0 / FORESIGHT)
    now = 1.0 - kept
    wanted = [now * (8.0 + kept * 4.0), now * (6.0 + kept * 2.0), now * 4.0, now * 2.0]
    np.testing.assert_allclose(cost_to_come(costs, 1.0, 2), wanted, rtol=1e-6)


def test_a_cost_that_stays_is_about_the_cost_to_come():
    assert cost_to_come(np.full(2000, 30.0), 1.0, 20)[0] == pytest.approx(30.0, rel=1e-3)


def test_plans_whose_candidates_were_all_lost_are_left_out(recorded, tmp_path):
    lossy = Recording.load(recorded)
    costs, lossy.costs = np.array(lossy.costs), Rows()
    for plan, row in enumerate(costs):
        lossy.costs.append(np.full_like(row, np.inf) if plan == 2 else row)
    lossy.save(tmp_path / "run.npz")
    found, whole = gather([tmp_path]), gather([recorded])
    assert len(found.knots) == len(whole.knots) - 1
    assert np.isfinite(found.to_come).all()
