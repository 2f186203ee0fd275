import numpy as np
import pytest

from sumo_dist.episode.follow import STAND_RAMP_S, Follower, misfit, unfollowable
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.robots.spot import spot_actions
from sumo_dist.timing import PLAN_RATE, TICK, anchor_tick

ACTIONS = spot_actions()
STAND = ACTIONS.unit(ACTIONS.default)
HORIZON = 0.5  # [s], 25 ticks


def plan(number, tick, value):
    knots = np.full((4, ACTIONS.size), value, np.float32)
    return Plan(number, tick, knots, HORIZON, "linear")


@pytest.fixture
def follower():
    return Follower(ACTIONS)


def test_stands_before_its_first_plan(follower):
    assert np.array_equal(follower.action(0), STAND)
    assert np.allclose(ACTIONS.physical(STAND), ACTIONS.default)
    assert not follower.exhausted(1000)


def test_follows_its_first_plan_at_once_even_if_it_is_early(follower):
    follower.offer(plan(0, 4, 0.5))
    assert follower.action(1) == pytest.approx(0.5)


def test_switches_to_a_plan_on_its_anchor(follower):
    follower.offer(plan(0, 0, 0.1))
    follower.action(0)
    follower.offer(plan(1, 2, 0.2))
    assert follower.action(1) == pytest.approx(0.1)
    assert follower.action(2) == pytest.approx(0.2)
    assert follower.plan.number == 1


def test_follows_each_plan_in_turn_when_several_are_ahead(follower):
    follower.offer(plan(0, 0, 0.1))
    follower.action(0)
    follower.offer(plan(1, 2, 0.2))
    follower.offer(plan(2, 5, 0.5))
    values = [follower.action(tick)[0] for tick in range(1, 7)]
    assert values == pytest.approx([0.1, 0.2, 0.2, 0.2, 0.5, 0.5])


def test_a_stream_of_plans_that_are_early_does_not_starve_it(follower):
    """A planner that is faster than it expected sends each plan before the last one is due."""
    follower.offer(plan(0, 0, 0.0))
    for number in range(1, 20):
        tick = 5 * number // 2
        follower.offer(plan(number, tick + 3, number / 100))
        follower.action(tick)
    assert follower.plan.number >= 17


def test_a_late_plan_is_followed_from_where_it_is_now(follower):
    knots = np.linspace(0.0, 1.0, 4)[:, None].repeat(ACTIONS.size, axis=1).astype(np.float32)
    follower.offer(Plan(0, 0, knots, HORIZON, "linear"))
    assert follower.action(10) == pytest.approx(10 * TICK / HORIZON)


def test_plans_out_of_order_are_dropped(follower):
    follower.offer(plan(3, 7, 0.3))
    follower.action(7)
    follower.offer(plan(2, 5, 0.2))
    follower.offer(plan(3, 7, -1.0))
    assert follower.action(8) == pytest.approx(0.3)


def test_of_two_plans_that_are_due_the_newer_counts(follower):
    follower.offer(plan(1, 2, 0.1))
    follower.offer(plan(2, 5, 0.2))
    assert follower.action(6) == pytest.approx(0.2)


def test_ramps_to_standing_when_the_plan_runs_out(follower):
    follower.offer(plan(0, 0, 1.0))
    end, ramp = round(HORIZON / TICK), round(STAND_RAMP_S / TICK)
    assert follower.action(end) == pytest.approx(1.0)
    assert not follower.exhausted(end)
    assert follower.exhausted(end + 1)
    shares = [0.0, 0.2, 0.6, 1.0]
    for share in shares:
        tick = end + round(share * ramp)
        assert follower.action(tick) == pytest.approx(1.0 - share + share * STAND)
    assert follower.action(end + 10 * ramp) == pytest.approx(STAND)


def test_takes_up_a_plan_after_standing(follower):
    follower.offer(plan(0, 0, 1.0))
    assert follower.action(500) == pytest.approx(STAND)
    follower.offer(plan(200, 500, 0.7))
    assert follower.action(501) == pytest.approx(0.7)
    assert not follower.exhausted(501)


def test_a_plan_that_fits_is_not_refused():
    knots = np.zeros((4, ACTIONS.size), np.float32)
    assert unfollowable(Plan(3, anchor_tick(3), knots, 1.0, "linear"), ACTIONS, PLAN_RATE) == ""


@pytest.mark.parametrize(
    ("knots", "tick", "reason"),
    [
        (lambda n: np.zeros((4, n + 1)), 7, "its knots have 10 numbers, this robot's actions 9"),
        (np.zeros, 7, "its knots have 0 numbers, this robot's actions 9"),
        (lambda n: np.full((4, n), 1.5), 7, "an action of 1.5, they lie in [-1, 1]"),
        (lambda n: np.zeros((4, n)), 8, "it is anchored on tick 8 instead of 7"),
    ],
)
def test_a_plan_that_does_not_fit_the_robot_is_refused(knots, tick, reason):
    given = Plan(3, tick, knots(ACTIONS.size), 1.0, "linear")
    assert unfollowable(given, ACTIONS, PLAN_RATE) == reason


def test_a_plan_from_far_ahead_would_keep_out_all_others():
    knots = np.zeros((4, ACTIONS.size), np.float32)
    far = Plan(1000, anchor_tick(1000), knots, 1.0, "linear")
    assert unfollowable(far, ACTIONS, PLAN_RATE, now=0) == "it begins 50 s from now, at most 2"
    assert unfollowable(far, ACTIONS, PLAN_RATE, now=2450) == ""


def report(terms=4, weights=4, parameters=4, nodes=5, number=3, width=ACTIONS.size):
    given = Plan(number, anchor_tick(number), np.zeros((nodes, width), np.float32), 0.5, "linear")
    numbers = (np.zeros(size) for size in (terms, weights, parameters))
    return PlanReport(given, np.zeros(6), np.ones(6, bool), *numbers, plan_ms=1.0, own_ms=1.0)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({}, ""),
        ({"terms": 3}, "it has (3, 4, 4) terms, weights and parameters, the robot's task has "),
        ({"weights": 5}, "it has (4, 5, 4) terms, weights and parameters"),
        ({"parameters": 0}, "it has (4, 4, 0) terms, weights and parameters"),
        ({"nodes": 4}, "it has 4 nodes, 5 were asked for"),
        ({"width": 8}, "its knots have 8 numbers, this robot's actions 9"),
        ({"number": 90}, "it begins 4 s from now, at most 2"),
    ],
)
def test_a_report_is_of_the_robots_task_and_of_what_was_asked_for(move_box, change, reason):
    """Whose numbers have other sizes would break the recording, whatever its knots are."""
    found = misfit(report(**change), move_box, PlannerConfig(), now=7)
    assert found.startswith(reason)
    assert bool(found) == bool(reason)
