"""The one line says what is the matter, and only that."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.view.verdict import RECENT_PLANS, Verdict

PLAN = Plan(0, 0, np.zeros((4, 2), np.float32), 1.5, "linear")
REPORT = PlanReport(
    *(PLAN, np.ones(4), np.ones(4, bool), np.ones(2), np.ones(2), np.ones(1)), 20.0, 1.0
)


def judged(*took_ms, budget=50.0, **changes):
    verdict = Verdict()
    for plan_ms in took_ms:
        verdict.add_plan(replace(REPORT, plan_ms=plan_ms, **changes), budget)
    return verdict


def test_before_the_first_plan_it_says_so():
    assert Verdict().line() == "**no plan yet**"


def test_plans_within_their_budget_are_on_time():
    line = judged(20.0, 30.0, 40.0).line()
    assert line == "**on time**: plans take 30 of 50 ms · planned at 1.00 of real time"


def test_plans_over_their_budget_are_late_and_by_how_much():
    line = judged(*[100.0] * 3, 40.0).line()
    assert "**late**: 75% of plans over 50 ms, median 100 ms" in line
    assert "planned at 0.50 of real time" in line


def test_the_budget_of_a_slower_clock_is_larger():
    assert "**on time**: plans take 100 of 200 ms" in judged(100.0, budget=200.0).line()


def test_one_late_plan_among_many_is_no_lateness_and_the_past_is_forgotten():
    assert "on time" in judged(*[20.0] * 30, 400.0).line()
    assert "on time" in judged(*[400.0] * 50, *[20.0] * RECENT_PLANS).line()


def test_the_speed_is_that_of_the_last_seconds():
    verdict = judged(20.0)
    for second, tick in enumerate((0, 50, 100, 125, 150)):
        verdict.add_tick(tick, 1000.0 + second)
    assert "runs at 0.50 of real time" in verdict.line()


def test_the_slowest_worker_is_named_and_what_is_wrong_with_others():
    verdict = judged(20.0)
    verdict.set_alive(3)
    verdict.add_worker("a", "answers", 300.0)
    verdict.add_worker("b", "answers", 120.0)
    assert "slowest worker b: 120 rollouts/s" in verdict.line()
    assert "wrong" not in verdict.line()
    verdict.add_worker("c", "passed over", 10.0)
    verdict.set_alive(2)
    assert "**wrong: 1 of 3 workers gone; worker c passed over**" in verdict.line()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"lost": 3}, "6 rollouts lost"),
        ({"invalid": 1}, "2 rollouts diverged"),
        ({"failed": True}, "2 plans failed, no candidate had a finite cost"),
    ],
)
def test_what_plans_lack_is_counted(changes, said):
    assert f"**wrong: {said}**" in judged(20.0, 20.0, **changes).line()


def test_without_a_worker_or_with_a_stopped_robot_something_is_wrong():
    verdict = judged(20.0)
    verdict.set_alive(0)
    assert "no rollout worker" in verdict.line()
    verdict.set_mode("stopped")
    assert "robot stopped" in verdict.line()
    verdict.set_mode("running")
    assert "robot" not in verdict.line()


def test_the_end_comes_first_and_names_the_command_that_shows_it_again():
    verdict = judged(20.0)
    verdict.set_mode("stopped")
    verdict.end("success", "sumo-dist replay runs/x")
    assert verdict.line().startswith("**ended: success** · again with `sumo-dist replay runs/x` ·")
    assert "robot" not in verdict.line()
