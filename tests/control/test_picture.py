import json
import time

import numpy as np
import pytest

from sumo_dist.control import picture as module
from sumo_dist.control.picture import Picture
from sumo_dist.episode.assemble import draw_start
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.tasks import load_task
from sumo_dist.wire.keys import SCHEMA, Member, unique_name, view_token
from sumo_dist.wire.messages import EpisodeEnd, EpisodeInfo, PlanMessage, Question, State
from sumo_dist.wire.notices import Ack, Event, Health, WorkerHealth, WorkerStatus

TASK = load_task("spot/move_box")
COST = TASK.table.defaults
STATE = draw_start(TASK, 1)


@pytest.fixture
def picture():
    picture = Picture("spot")
    picture.take(info())
    return picture


def info(run="r", task="spot/move_box", seed=3, **changes):
    config = EpisodeConfig(task, seed, PlannerConfig(rollouts=4), **changes)
    return EpisodeInfo(run, config.to_json(), "hash", 1)


def plan(number, run="r", costs=(3.0, 2.0, 9.0), finite=(True, True, False)):
    made = Plan(number, 5 * number // 2, np.zeros((5, 2), np.float32), 1.5, "smooth")
    report = PlanReport(
        made,
        np.array(costs),
        np.array(finite),
        np.arange(4.0),
        COST.weights,
        COST.parameters,
        30.0,
        1.0,
    )
    return PlanMessage.of(run, report)


def question(tick=5, clock="realtime", speed=0.5, run="r"):
    settings = vars(PlannerConfig(rollouts=4))
    return Question(
        *(run, -1, tick, clock, speed, STATE, np.empty(0, np.float32), None),
        *(COST.weights, COST.parameters, settings),
    )


def test_the_offer_says_what_may_be_changed_and_is_json(picture):
    offer = json.loads(json.dumps(picture.offer))
    assert (offer["task"], offer["seed"], offer["robot"]) == ("spot/move_box", 3, "spot")
    assert offer["run"] == picture.snapshot()["run"]
    assert (
        offer["terms"] == [range_["name"] for range_ in offer["weights"]] == list(TASK.table.terms)
    )
    assert all(name.startswith("spot/") for name in offer["tasks"])
    assert "spot/move_tire" in offer["tasks"]
    settings = {range_["name"]: range_ for range_ in offer["settings"]}
    assert "ps" in settings["optimizer"]["choices"]
    assert settings["rollouts"]["kind"] == "int"
    assert not {"nodes", "rate"} & set(settings)  # an episode's
    assert offer["places"] == ["goal"]
    assert len(offer["parameters"][0]) == 2


def test_before_an_episode_there_is_a_picture_too():
    shown = json.loads(json.dumps(Picture("spot").snapshot()))
    assert shown["robot"]["mode"] == "gone"
    assert shown["plan"] is shown["floor"] is shown["numbers"] is None


def test_states_plans_and_numbers_are_shown(picture):
    for tick in range(3):
        picture.take(State("r", tick, STATE))
    picture.take(State("r", 1, STATE))  # late
    picture.take(question(tick=2))
    picture.take(plan(8))  # the page was opened late
    picture.take(plan(11))
    picture.take(plan(11))  # twice, as in lockstep
    shown = json.loads(json.dumps(picture.snapshot()))
    assert shown["robot"]["tick"] == 2
    assert shown["plan"]["missed"] == 2
    assert (shown["plan"]["period_ms"], shown["plan"]["budget_ms"]) == (50.0, 100.0)
    assert (shown["plan"]["cost"], shown["plan"]["best"]) == (6.0, 2.0)
    assert shown["numbers"]["weights"] == COST.weights.tolist()
    assert shown["numbers"]["settings"]["rollouts"] == 4
    assert len(shown["floor"]["places"]) == 2


def test_a_lockstep_plan_has_no_deadline_and_none_need_be_finite(picture):
    picture.take(question(clock="lockstep"))
    picture.take(plan(0, finite=(False, False, False)))
    assert picture.snapshot()["plan"]["budget_ms"] is None
    assert picture.snapshot()["plan"]["best"] is None


def test_another_episode_begins_anew_and_what_is_late_of_the_first_is_left_out(picture):
    picture.take(State("r", 7, STATE))
    picture.take(plan(4))
    picture.take(EpisodeEnd("r", 7, "replaced: reset by tester", False, False))
    first = picture.offer
    picture.take(info("r2", "spot/move_tire"))
    picture.take(plan(5))
    picture.take(State("r", 8, STATE))
    shown = picture.snapshot()
    assert picture.offer is not first
    assert picture.offer["task"] == "spot/move_tire"
    assert shown["plan"] is None
    assert shown["end"] is None
    assert any("replaced: reset" in event["text"] for event in shown["events"])


def test_what_comes_before_its_episode_is_shown_with_it(picture):
    picture.take(question(10, run="r2"))
    picture.take(plan(4, "r2"))
    picture.take(plan(9, "other"))
    picture.take(info("r2", "spot/move_box"))
    shown = picture.snapshot()
    assert shown["plan"] is None  # the newest of its kind was another's
    assert shown["numbers"]["tick"] == 10
    assert shown["floor"] is not None  # a question has a state, too: a paused robot has no other


def test_an_episode_that_is_not_known_here_is_told_and_harms_nothing(picture):
    picture.take(info("r2", "/nowhere/task.py"))
    assert picture.offer is None
    picture.take(State("r2", 0, STATE))
    assert "cannot be steered from here" in picture.snapshot()["events"][-1]["text"]


def test_a_state_of_another_robot_is_not_drawn(picture):
    picture.take(State("r", 0, np.zeros(7)))
    assert picture.snapshot()["floor"] is None


def test_workers_are_told_of_with_what_they_and_the_optimizer_say(picture, monkeypatch):
    picture.member(Member("worker", "a", SCHEMA, "b"), True)
    picture.member(Member("worker", "b", SCHEMA, "b"), True)
    told = [
        WorkerStatus("a", "answers", 312.4, 3, 0.1),
        WorkerStatus("gone", "passed over", 0.0, 9, 5.0),
    ]
    picture.take(WorkerHealth.of("", "optimizer", told))
    picture.take(Health("", "a", "worker", {"host": "rack-1"}))
    rows = {row["name"]: row for row in picture.snapshot()["workers"]}
    host, state, alive, rate, lost = (
        rows["a"][key] for key in ("host", "state", "alive", "per_s", "lost")
    )
    assert (host, state, alive, rate, lost) == ("rack-1", "answers", True, 312.4, 3)
    assert rows["b"]["state"] == "not asked"
    assert rows["gone"]["alive"] is False
    monkeypatch.setattr(module, "SILENT_S", 0.0)
    picture.member(Member("worker", "a", SCHEMA, "b"), False)
    assert [row["name"] for row in picture.snapshot()["workers"]] == ["b"]


def test_events_are_numbered_and_bounded(picture):
    for number in range(300):
        picture.take(Event("", "optimizer", "warning", f"event {number}"))
    picture.take(Ack("r", 1, "x", 0, ""))
    picture.take(Ack("r", 2, "x", 0, "no such term"))
    events = picture.snapshot()["events"]
    assert len(events) == module.EVENTS
    assert [event["number"] for event in events] == list(range(202, 302))
    assert events[-1]["text"] == "refused to x: no such term"


@pytest.mark.alone
def test_the_speed_is_not_that_of_a_burst(picture):
    began = time.monotonic()
    for tick in range(50):
        picture.take(State("r", tick, STATE))
    assert time.monotonic() - began < 1.0
    assert picture.snapshot()["robot"]["speed"] <= 50 * 0.02 / (module.RATE_S / 4)


def test_the_view_is_that_of_a_tracer_of_this_machine(picture):
    assert picture.view is None
    picture.member(Member("tracer", "elsewhere-12", SCHEMA, view_token(1, 2)), True)
    assert picture.view is None
    picture.member(Member("tracer", unique_name(), SCHEMA, "-"), True)
    assert picture.view is None
    assert picture.snapshot()["view"] == ""
    name = unique_name()
    picture.member(Member("tracer", name, SCHEMA, view_token(9090, 9876)), True)
    assert picture.view == (9090, 9876)
    assert picture.snapshot()["view"] == name
