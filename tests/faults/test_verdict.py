"""What a run is judged by: its end, and that planning resumed."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.commands.chaos import text
from sumo_dist.episode.ending import End, Ending, fault
from sumo_dist.faults.growth import Growth
from sumo_dist.faults.occurrence import FaultOccurrence
from sumo_dist.faults.run import episode_of
from sumo_dist.faults.script import Fault, Script
from sumo_dist.faults.verdict import RunRecord, counted, judge
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.record.recording import Recording
from sumo_dist.robots.spot import SPOT
from sumo_dist.tasks import load_task

SUMMARY = {
    "plans": 3,
    "robot_time_s": 0.1,
    "real_time_factor": 0.3,
    "rollouts_per_plan_p50": 10.0,
}
SCRIPT = Script((Fault("kill", 1, "local-0"),))
FELL, TIMEOUT = Ending(End.FELL), Ending(End.TIMEOUT)


@pytest.fixture(scope="module")
def recording():
    config = episode_of(SCRIPT)
    problem = Problem.build(load_task(config.task), planning_options(config.planner))
    recording = Recording(config.describe(problem, ("none", "none")))
    for _ in range(3):
        recording.targets.append(np.array(SPOT.stand))
    return recording


@pytest.fixture
def judged(recording, tmp_path):
    """Return a function that judges a run which ended somehow."""

    def judged(end, occurrences, script=SCRIPT, without=None, until=20.0):
        (tmp_path / "messages.txt").write_text("")
        ended = {"end": end.kind, "end_reason": end.reason}
        (tmp_path / "summary.json").write_text(json.dumps(SUMMARY | ended))
        recording.save(tmp_path / "run.npz")

        def undisturbed():
            assert without is not None, "it was played for nothing"
            return without.reason

        record = RunRecord(script, tmp_path, 1, occurrences, ended_at=until)
        return judge(record, undisturbed)

    return judged


def occurrence(ended, resumed):
    return FaultOccurrence(SCRIPT.faults[0], 1.0, ended, resumed)


def test_a_fall_counts_only_if_the_run_without_faults_does_not_fall(judged):
    worse = judged(FELL, [], without=TIMEOUT)
    assert worse.failures == (
        "it ended: fell; without faults: timeout",
        "0 of 1 faults happened before it ended",
    )
    same = judged(FELL, [], without=FELL)
    assert (same.failures, same.undisturbed) == ((), "fell")


def test_other_ends_need_no_second_run(judged):
    assert judged(TIMEOUT, [occurrence(2.0, 2.5)]).failures == ()
    stopped = judged(Ending(End.STOPPED, "me"), [occurrence(2.0, 2.5)])
    assert stopped.failures == ("it ended: stopped by me",)
    assert judged(FELL, [], replace(SCRIPT, faults=())).failures == ("it ended: fell",)


def test_planning_must_resume_in_time(judged):
    late = judged(TIMEOUT, [occurrence(2.0, 4.0)])
    assert late.failures == ("planning resumed 2.00 s after kill local-0",)
    assert late.slowest_s == 2.0


def test_planning_that_never_resumes_is_late_unless_the_robot_sat_down(judged):
    never = occurrence(2.0, None)
    assert judged(TIMEOUT, [never]).failures == ("no plan for 18.00 s after kill local-0",)
    blind = replace(fault("no state for 0.1 s"), sat_down=True)
    assert judged(blind, [never], replace(SCRIPT, ends=(blind.reason,))).failures == ()


def test_a_fall_that_is_not_the_faults_is_told_without_being_a_failure(judged):
    said = "\n".join(text([judged(FELL, [], without=FELL)]))
    assert "0 runs not as they must be" in said
    assert "- script seed 1: it fell, as it does without faults" in said


def test_the_tracer_may_grow():
    growths = [Growth(name, 1, 9.0, (100.0, 250.0), (9.0, 9.0)) for name in ("tracer", "optimizer")]
    assert [growth.service for growth in counted(growths)] == ["optimizer"]
