import json
from dataclasses import asdict

import numpy as np
import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End, Ending, fault
from sumo_dist.episode.summary import one_line, read_summary, summarise, write_summary
from sumo_dist.errors import SumoError
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.recording import Recording
from sumo_dist.record.rows import Rows
from sumo_dist.timing import anchor_tick

CONFIG = {
    "task_name": "spot/move_box",
    "robot": "spot",
    "engine": "native-avx2",
    "config_hash": "0123",
    "episode": asdict(EpisodeConfig("spot/move_box", seed=3, plant="hard", estimator="lowpass")),
    "versions": {"sumo-dist": "0"},
}
SUCCESS, TIMEOUT, FELL = Ending(End.SUCCESS), Ending(End.TIMEOUT), Ending(End.FELL)


@pytest.fixture
def recording():
    """51 ticks, and plans 0, 1, 2 and 5 of 10, 20, 30 and 40 ms."""
    recording = Recording(CONFIG)
    for tick in range(51):
        recording.add_tick(np.full(3, 1.0 * tick), np.full(3, 1.0 * tick), np.zeros(2, np.float32))
    for number, lost, reissued in ((0, 0, 0), (1, 4, 0), (2, 0, 0), (5, 0, 8)):
        knots = np.zeros((4, 9), np.float32)
        plan = Plan(number, anchor_tick(number), knots, 1.5, "linear")
        plan_ms = 10.0 * (len(recording.plan_ms) + 1)
        costs, finite = np.zeros(16), np.ones(16, bool)
        recording.add_plan(
            PlanReport(
                *(plan, costs, finite, np.zeros(4), np.ones(4), np.zeros(4), plan_ms),
                own_ms=1.0,
                lost=lost,
                reissued=reissued,
            )
        )
    return recording


def test_a_solved_run_has_a_completion_time(recording):
    summary = summarise(recording, SUCCESS.after(4.0))
    assert summary["success"] is True
    assert summary["completion_time_s"] == summary["robot_time_s"] == 1.0
    assert summary["real_time_factor"] == 0.25
    renamed = {"task": CONFIG["task_name"], **CONFIG}
    del renamed["task_name"], renamed["episode"]
    assert {key: summary[key] for key in renamed} == renamed
    assert (summary["clock"], summary["seed"], summary["optimizer"]) == ("lockstep", 3, "ps")
    assert (summary["plant"], summary["estimator"]) == ("hard", "lowpass")


def test_a_run_that_failed_has_none(recording):
    summary = summarise(recording, FELL.after(4.0))
    assert (summary["success"], summary["completion_time_s"]) == (False, None)
    assert (summary["end"], summary["end_reason"]) == ("fell", "fell")
    assert summary["robot_time_s"] == 1.0


@pytest.mark.parametrize(
    ("ending", "end", "reason"),
    [
        (Ending(End.FAILURE, "tipped"), "failure", "tipped"),
        (Ending(End.STOPPED, "ann: dog", True), "stopped", "stopped by ann: dog, the robot sat "),
        (fault("no plan"), "fault", "fault: no plan"),
    ],
)
def test_the_end_is_a_word_for_programs_and_a_reason_for_people(recording, ending, end, reason):
    summary = summarise(recording, ending)
    assert summary["end"] == end
    assert summary["end_reason"].startswith(reason)
    assert f"not solved: {reason}" in one_line(summary)


def test_the_account_counts_what_was_lost(recording):
    summary = summarise(recording, TIMEOUT.after(1.0))
    assert summary["plans"] == 4
    assert summary["plan_ms_p50"] == 25.0
    assert summary["missed_deadlines"] == 2  # plans 3 and 4 never came
    assert summary["partial_plans"] == 1
    assert summary["rollouts_lost"] == 12
    line = one_line(summary)
    assert "spot/move_box seed 3: not solved: timeout" in line
    assert "2 missed deadlines, 1 partial plans, 12 rollouts lost" in line


def test_the_line_of_a_clean_run_has_no_troubles(recording):
    recording.plan_numbers = Rows(range(4))
    recording.lost = recording.reissued = Rows([0, 0, 0, 0])
    line = one_line(summarise(recording, SUCCESS.after(2.0)))
    assert "solved in 1.0 s, 4 plans of 25 ms" in line
    assert line.endswith("0.50x real time, ps on native-avx2")


def test_a_run_that_ended_before_it_began_is_accounted_for():
    summary = summarise(Recording(CONFIG), fault("no answer").after(60.0))
    assert (summary["plans"], summary["robot_time_s"]) == (0, 0.0)
    assert summary["plan_ms_p50"] is None
    assert summary["real_time_factor"] == 0.0
    assert "not solved: fault: no answer" in one_line(summary)
    json.dumps(summary, allow_nan=False)


def test_what_planning_cost_is_known_where_one_process_did_it(recording):
    summary = summarise(recording, TIMEOUT.after(1.0))
    assert (summary["plan_cpu_ms"], summary["plan_cpu_s"]) == (None, None)
    recording.plan_cpu_ms = Rows([100.0, 200.0, 300.0, 600.0])
    summary = summarise(recording, TIMEOUT.after(1.0))
    assert (summary["plan_cpu_ms"], summary["plan_cpu_s"]) == (300.0, 1.2)


def test_digests_name_the_bits(recording):
    before = summarise(recording, TIMEOUT.after(1.0))
    again = summarise(recording, TIMEOUT.after(1.0))
    assert before["plan_digest"] == again["plan_digest"]
    knots, states = np.array(recording.knots), np.array(recording.states)
    knots[2, 0, 0] = np.nextafter(knots[2, 0, 0], np.float32(1))
    states[7, 0] = np.nextafter(states[7, 0], 1e9)
    recording.knots, recording.states = Rows(knots), Rows(states)
    after = summarise(recording, TIMEOUT.after(1.0))
    assert after["plan_digest"] != before["plan_digest"]
    assert after["state_digest"] != before["state_digest"]


def test_reads_what_was_written(recording, tmp_path):
    summary = summarise(recording, TIMEOUT.after(1.0))
    write_summary(summary, tmp_path)
    assert read_summary(tmp_path) == summary


@pytest.mark.parametrize("content", [None, "", "{"])
def test_a_missing_or_broken_summary_is_one_clear_error(tmp_path, content):
    if content is not None:
        (tmp_path / "summary.json").write_text(content)
    with pytest.raises(SumoError, match=r"the run left no readable .*summary\.json"):
        read_summary(tmp_path)


def test_plans_of_different_sizes_are_kept_and_counted(recording, tmp_path):
    knots = np.zeros((4, 9), np.float32)
    plan = Plan(6, anchor_tick(6), knots, 1.5, "linear")
    numbers = np.zeros(4), np.ones(4), np.zeros(4)
    few = PlanReport(plan, np.zeros(5), np.ones(5, bool), *numbers, 9.0, own_ms=1.0)
    recording.add_plan(few)
    recording.save(tmp_path / "run.npz")
    again = Recording.load(tmp_path / "run.npz")
    assert list(again.rollouts) == [16, 16, 16, 16, 5]
    assert np.isfinite(again.costs[-1]).tolist() == [True] * 5 + [False] * 11
    summary = summarise(again, TIMEOUT.after(1.0))
    assert (summary["rollouts_per_plan_p50"], summary["rollouts_per_plan_min"]) == (16.0, 5)


def test_a_tick_and_a_plan_that_were_interrupted_are_dropped(recording):
    recording.states.append(np.zeros(3))
    recording.plan_numbers.append(6)
    recording.drop_unfinished()
    summary = summarise(recording, Ending(End.INTERRUPTED).after(1.0))
    assert (summary["plans"], summary["robot_time_s"]) == (4, 1.0)
