"""Lanes say what robot, plans and workers did, once for each change."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.ending import End, Ending
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.rrd_file import RrdFile
from sumo_dist.view.states import JUDGED_TICKS, MOST_LANES, STANDS, WALKS, WORKER_LANES, StateLog


def report(tick, plan_ms=20.0, horizon=0.4, **account):
    plan = Plan(tick, tick, np.zeros((4, 2), np.float32), horizon, "linear")
    costs = np.ones(4), np.ones(4, bool), np.ones(1), np.ones(1), np.ones(0)
    return replace(PlanReport(plan, *costs, plan_ms, 1.0), **account)


@pytest.fixture
def lanes(tmp_path, read_rrd):
    """A function that fills lanes: returns for each its states by tick, and their colours."""

    def lanes(fill):
        with Outputs("test", RrdFile(tmp_path / "a.rrd", pytest.fail)) as out:
            fill(StateLog(out))
        rrd = read_rrd(tmp_path / "a.rrd")
        found = {}
        for name, lane in rrd.timed.items():
            if "StateChange:state" in lane:
                ticks = [round(time.total_seconds() / 0.02) for time in lane["sim_time"]]
                words = [state[0] for state in lane["StateChange:state"]]
                found[name[1:]] = dict(zip(ticks, words, strict=True))
                known = rrd.static[name]["StateConfiguration:values"][0]
                assert set(words) <= set(known)  # each has a colour that means something
        return found

    return lanes


def test_the_robot_stands_when_its_plan_has_run_out(lanes):
    def fill(log):
        log.plan(report(0), 50.0)
        for tick in range(40):
            log.reached(tick)
        log.plan(report(40), 50.0)
        log.reached(41)

    assert lanes(fill)["robot"] == {0: WALKS, 21: STANDS, 41: WALKS}


def test_the_robots_own_word_comes_first_and_the_end_last(lanes):
    def fill(log):
        for tick, mode in enumerate(("running", "stopping", "stopped", "rising", "paused")):
            log.mode(mode)
            log.reached(tick)
        log.end(9, Ending(End.FELL).reason)
        log.reached(10)

    shown = [WALKS, "stopping", "stopped, sitting", "rising", "paused", "fell"]
    assert list(lanes(fill)["robot"].values()) == shown


@pytest.mark.parametrize("kind", list(End))
def test_every_end_has_its_word(kind, lanes):
    reason = Ending(kind, "operator").reason
    shown = lanes(lambda log: log.end(3, reason))["robot"][3]
    assert shown == (kind.value if reason != "operator" else "failure")


def test_the_worst_of_some_plans_is_shown(lanes):
    def fill(log):
        log.plan(report(0), 50.0)
        log.plan(report(2, plan_ms=70.0), 50.0)
        log.plan(report(5, failed=True), 50.0)
        for tick in range(6, 60, 2):
            log.plan(report(tick), 50.0)

    shown = lanes(fill)["plans"]
    assert list(shown.values()) == ["on time", "late", "failed", "on time"]
    assert list(shown)[-1] == pytest.approx(5 + JUDGED_TICKS, abs=2)


def test_a_sick_worker_is_told_from_one_that_has_left(lanes):
    def fill(log):
        log.worker(1, "a", "answers")
        log.worker(2, "a", "answers")
        log.worker(3, "a", "passed over")
        log.worker(4, "a", "has another build of the engine")
        log.gone(5, "a")
        log.gone(5, "b")  # nobody knew it

    assert lanes(fill) == {"workers/a": {1: "answers", 3: "silent", 4: "refuses", 5: "gone"}}


def test_of_very_many_workers_those_that_are_sick_have_a_lane(lanes):
    def fill(log):
        for i in range(200):
            log.worker(1, f"w{i}", "answers")
        log.worker(2, "w150", "passed over")
        for i in range(200):
            log.worker(3, f"w{i}", "passed over")

    shown = lanes(fill)
    assert len(shown) == MOST_LANES > WORKER_LANES
    assert shown["workers/w150"] == {2: "silent"}
