"""The robot's side of the bus; the other side is scripted."""

import threading
import time
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.dispatch import robot_link
from sumo_dist.dispatch.robot_link import RobotLink
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import Interrupted, Stopped, SumoError, TaskError
from sumo_dist.estimate.readings import Readings
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.tasks import load_task
from sumo_dist.timing import anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import (
    EpisodeEnd,
    EpisodeInfo,
    NoPlan,
    PlanMessage,
    Question,
    Sensors,
    State,
)
from sumo_dist.wire.notices import CommandMessage

MEMORY = np.zeros(12, np.float32)
COST = load_task("spot/move_box").table.defaults
TERMS, PARAMETERS = len(COST.weights), len(COST.parameters)


def readings(tick):
    none = np.empty(0, np.int64)
    return Readings(
        tick, np.full(64, float(tick)), none, np.empty((0, 38)), none, np.empty((0, 2, 7))
    )


def plan_message(number, tick=None, run="run", knots=(5, 9), terms=TERMS, parameters=PARAMETERS):
    tick = anchor_tick(number) if tick is None else tick
    plan = Plan(number, tick, np.full(knots, 0.1, np.float32), 1.5, "linear")
    costs = np.zeros(3), np.ones(3, bool)
    numbers = np.zeros(terms), np.zeros(terms), np.zeros(parameters)
    return PlanMessage.of(run, PlanReport(plan, *costs, *numbers, 1.0, 1.0))


def plan_request(number):
    return PlanRequest(number, anchor_tick(number), np.zeros(64), MEMORY, None, COST)


class Ends:
    """The robot's link and a bus at the other end."""

    def __init__(self, stack, endpoint, robot, config, wait=30.0):
        self.told, self.seen, self.stop = [], [], threading.Event()
        self.infos = []
        self.config = config
        self.other = stack.enter_context(Bus.dial(endpoint, robot))
        self.other.subscribe(EpisodeInfo, self.infos.append)
        bus = stack.enter_context(Bus.dial(endpoint, robot, run="session"))
        self.link = RobotLink(
            bus, wait, self.stop, lambda *told: self.told.append(told), self.seen.append
        )
        self.episode = Episode.assemble(EpisodeConfig("spot/move_box", planner=config))
        self.link.enter(self.episode, self.info("run"))
        self.meet()

    def info(self, run, number=1):
        return EpisodeInfo(run, self.episode.config.to_json(), self.episode.problem.hash, number)

    def meet(self):
        """Speak until heard: what is said before the router knows both ends is lost."""
        deadline = time.monotonic() + 30.0
        while not self.seen:
            assert time.monotonic() < deadline, "the link hears nothing"
            self.other.publish(plan_message(2))
            time.sleep(0.05)
        time.sleep(0.2)  # for what was said twice
        self.seen.clear()
        self.link.new_plans()


@pytest.fixture
def ends(router, robot, config):
    with ExitStack() as stack:
        yield Ends(stack, router, robot, config)


def test_the_state_of_a_tick_is_asked_for_until_it_comes(ends):
    heard = []

    def third_time(sensors):
        heard.append(sensors.tick)
        if len(heard) == 3:
            ends.other.publish(State("run", sensors.tick - 1, np.zeros(64)))
            ends.other.publish(State("run", sensors.tick, sensors.truth))

    ends.other.subscribe(Sensors, third_time)
    assert np.array_equal(ends.link.ask_state(readings(7)), np.full(64, 7.0))
    assert heard == [7, 7, 7]


def test_the_plan_of_a_state_is_asked_for_until_it_comes(ends):
    asked = []

    def second_time(question):
        asked.append((question.tick, question.number, question.clock))
        if len(asked) == 2:
            for number in (3, 5, 4):
                ends.other.publish(plan_message(number))

    ends.other.subscribe(Question, second_time)
    report = ends.link.ask_plan(plan_request(4), ends.config)
    assert (report.plan.number, report.plan.tick) == (4, 10)
    assert asked == [(10, 4, "lockstep")] * 2


def test_a_question_says_all_that_its_plan_depends_on(ends):
    weights, parameters = 3.0 * COST.weights, COST.parameters + 0.25
    cost = replace(COST, weights=weights, parameters=parameters)
    followed = plan_message(3).plan
    state, memory = np.arange(64.0), np.arange(12, dtype=np.float32)
    request = PlanRequest(4, 10, state, memory, followed, cost)
    heard = []

    def hear(question):
        heard.append(question)
        ends.other.publish(plan_message(4))

    ends.other.subscribe(Question, hear)
    ends.link.ask_plan(request, replace(ends.config, rollouts=17))
    question = heard[0]
    assert (question.run, question.number, question.tick, question.speed) == ("run", 4, 10, 1.0)
    for sent, received in (
        (state, question.state),
        (memory, question.memory),
        (weights, question.weights),
        (parameters, question.parameters),
        (followed.knots, question.followed.knots),
    ):
        assert np.array_equal(sent, received)
    assert question.settings["rollouts"] == 17


def test_a_question_of_a_state_that_makes_no_sense_is_not_asked(ends, eventually):
    heard = []
    ends.other.subscribe(Question, heard.append)
    request = plan_request(4)

    def first():
        ends.link.send_question(request, ends.config, 0.5)
        time.sleep(0.05)
        return heard

    assert eventually(first, 30.0)
    assert (heard[0].clock, heard[0].speed) == ("realtime", 0.5)
    time.sleep(0.3)
    before = len(heard)
    ends.link.send_question(replace(request, state=np.full(64, np.nan)), ends.config, 0.5)
    ends.link.send_question(replace(request, tick=99), ends.config, 0.5)
    assert eventually(lambda: len(heard) > before)
    assert heard[before].tick == 99


# Which episode it is


def test_the_episode_is_announced_and_again_with_a_repeated_question_and_to_who_joins(
    ends, router, robot, eventually
):
    assert eventually(lambda: ends.infos)
    first = ends.infos[0]
    assert (first.run, first.number, first.task_hash) == ("run", 1, ends.episode.problem.hash)
    assert EpisodeConfig.from_json(first.config) == ends.episode.config
    before = len(ends.infos)
    ends.other.subscribe(Question, lambda question: _answer_the_third(ends, question))
    ends.link.ask_plan(plan_request(4), ends.config)
    assert eventually(lambda: len(ends.infos) >= before + 2)  # not with the first question
    before = len(ends.infos)
    with Bus.dial(router, robot) as late:
        late.announce("worker", "w-1")
        assert eventually(lambda: len(ends.infos) > before)


def _answer_the_third(ends, question):
    ends.asked = getattr(ends, "asked", 0) + 1
    if ends.asked == 3:
        ends.other.publish(plan_message(question.number))


def test_another_episode_begins_with_nothing_of_the_last_one(ends, eventually):
    ends.link.send_readings(readings(9))
    ends.other.publish(State("run", 9, np.full(64, 9.0)))
    ends.other.publish(plan_message(3))
    assert eventually(lambda: ends.seen and ends.link.newest_state(9, 0.0))
    ends.link.enter(ends.episode, ends.info("next", 2))
    assert ends.link.newest_state(0, 0.0) is None
    assert ends.link.new_plans() == []
    ends.other.publish(plan_message(4))  # late
    ends.other.publish(State("run", 0, np.zeros(64)))
    ends.other.publish(plan_message(1, run="next"))
    assert eventually(lambda: ends.seen[-1].plan.number == 1)
    assert [report.plan.number for report in ends.link.new_plans()] == [1]
    assert ends.link.newest_state(0, 0.1) is None
    assert eventually(lambda: ends.infos[-1].run == "next")


def test_the_end_of_an_episode_is_said(ends, eventually):
    ended = []
    ends.other.subscribe(EpisodeEnd, ended.append)

    def said():
        ends.link.end(7, "success", True, True)
        return ended

    assert eventually(said, 30.0)
    assert (ended[0].run, ended[0].tick, ended[0].reason) == ("run", 7, "success")
    assert (ended[0].success, ended[0].last) == (True, True)


def test_plans_of_another_run_are_not_heard(ends, eventually):
    ends.other.publish(plan_message(0, run="other"))
    ends.other.publish(plan_message(1))
    assert eventually(lambda: ends.seen)
    assert [report.plan.number for report in ends.link.new_plans()] == [1]


def test_new_plans_come_in_order_and_once(ends, eventually):
    for number in (2, 0, 1):
        ends.other.publish(plan_message(number))
    assert eventually(lambda: len(ends.seen) == 3)
    assert [report.plan.number for report in ends.link.new_plans()] == [0, 1, 2]
    assert ends.link.new_plans() == []


def test_a_late_plan_of_the_calibration_is_no_plan_of_the_run(ends, eventually):
    """Calibration makes plans 0, 1, ... of tick 0; sent twice, the last comes after the start."""
    ends.other.publish(plan_message(11, tick=0))
    ends.other.publish(plan_message(1))
    assert eventually(lambda: len(ends.seen) == 2)
    assert [report.plan.number for report in ends.link.new_plans()] == [1]


def test_the_newest_state_is_waited_for_no_longer_than_told(ends, eventually):
    began = time.monotonic()
    assert ends.link.newest_state(0, patience=0.1) is None
    assert 0.09 < time.monotonic() - began < 5.0
    ends.link.send_readings(readings(9))
    ends.other.publish(State("run", 3, np.full(64, 3.0)))
    assert eventually(lambda: ends.link.newest_state(3, patience=0.0) is not None)
    tick, state = ends.link.newest_state(9, patience=0.05)  # not there yet: the last one
    assert (tick, state[0]) == (3, 3.0)


def test_an_older_state_does_not_replace_a_newer_one(ends, eventually):
    ends.link.send_readings(readings(5))
    ends.other.publish(State("run", 5, np.full(64, 5.0)))
    ends.other.publish(State("run", 4, np.full(64, 4.0)))
    assert eventually(lambda: ends.link.newest_state(5, patience=0.0) is not None)
    time.sleep(0.05)
    assert ends.link.newest_state(0, patience=0.0)[0] == 5


def test_a_state_from_the_future_does_not_hide_those_that_follow(ends, eventually):
    ends.link.send_readings(readings(5))
    ends.other.publish(State("run", 2**40, np.full(64, 1.0)))
    ends.other.publish(State("run", 5, np.full(64, 5.0)))
    assert eventually(lambda: ends.link.newest_state(5, patience=0.0) is not None)
    assert ends.link.newest_state(5, patience=0.0)[0] == 5
    assert ends.link.refused == 1


def test_gives_up_with_a_reason_when_nobody_answers(router, robot, config, monkeypatch):
    monkeypatch.setattr(robot_link, "NOTICE_S", 0.3)
    with ExitStack() as stack:
        ends = Ends(stack, router, robot, config, wait=0.6)
        with pytest.raises(SumoError, match=r"no answer to the request for a plan in 0\.6 s"):
            ends.link.ask_plan(plan_request(0), config)
        with pytest.raises(SumoError, match=r"no answer to the request for a state in 0\.6 s"):
            ends.link.ask_state(readings(0))
        assert [text for _, text in ends.told] == ["waiting for a plan", "waiting for a state"]


def test_ends_its_waiting_when_told_to_stop(ends):
    threading.Timer(0.2, ends.stop.set).start()
    with pytest.raises(Interrupted):
        ends.link.ask_state(readings(0))


def test_it_is_told_at_once_that_no_plan_will_come(ends, eventually):
    def asking():
        with pytest.raises(TaskError, match=r"^success: mine.py, line 3$"):
            ends.link.ask_plan(plan_request(4), ends.config)

    thread = threading.Thread(target=asking)
    thread.start()
    ends.other.publish(NoPlan("run", "success: mine.py, line 3"))
    thread.join(10.0)
    assert not thread.is_alive()
    with pytest.raises(TaskError):  # in realtime, where nobody waits for plans
        ends.link.new_plans()
    ends.link.enter(ends.episode, ends.info("next", 2))
    assert ends.link.new_plans() == []


def test_a_stop_ends_its_waiting_at_once(ends, eventually):
    def stopping():
        with pytest.raises(Stopped, match="while waiting for a plan"):
            ends.link.ask_plan(plan_request(4), ends.config)

    asking = threading.Thread(target=stopping)
    asking.start()
    ends.other.publish(CommandMessage("any", 0, "tester", "stop", "", "smoke"))
    asking.join(10.0)
    assert not asking.is_alive()
    assert [command.verb for command in ends.link.operator.take(0, 0.0)] == ["stop"]


# What does not fit the robot's episode is dropped by name, and counted.


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (
            plan_message(4, terms=TERMS + 1),
            f"it has ({TERMS + 1}, {TERMS + 1}, {PARAMETERS}) terms, weights and parameters, "
            f"the robot's task has ({TERMS}, {TERMS}, {PARAMETERS})",
        ),
        (plan_message(4, parameters=PARAMETERS + 2), "terms, weights and parameters"),
        (plan_message(4, knots=(4, 9)), "it has 4 nodes, 5 were asked for"),
        (plan_message(4, knots=(5, 25)), "its knots have 25 numbers, this robot's actions 9"),
        (plan_message(4, tick=11), "it is anchored on tick 11 instead of 10"),
        (plan_message(10_000), "it begins 500 s from now, at most 2"),
        (State("run", 0, np.zeros(57)), "a state of tick 0 with 57 numbers is refused"),
        (State("run", 2**40, np.zeros(64)), f"a state of tick {2**40} with 64 numbers is refused"),
    ],
)
def test_what_does_not_fit_the_robot_is_refused_by_name_and_counted(
    ends, eventually, message, reason
):
    for count in (1, 2):
        ends.other.publish(message)
        assert eventually(lambda count=count: ends.link.refused == count)
    ends.other.publish(State("run", 0, np.zeros(64)))
    ends.other.publish(plan_message(4))
    assert eventually(lambda: ends.seen and ends.link.newest_state(0, 0.0))
    assert [report.plan.number for report in ends.link.new_plans()] == [4]
    assert ends.link.refused == 2
    ((level, text),) = ends.told  # once
    assert level == "error"
    assert reason in text
    assert text.endswith("; from now on only counted")


def test_a_lie_about_the_episode_is_refused_and_put_right(ends, eventually):
    """Else the others would take up the episode that somebody else tells of, and stay there."""
    assert eventually(lambda: ends.infos)
    time.sleep(0.2)
    before = len(ends.infos)
    ends.other.publish(ends.info("somebody-else"))
    assert eventually(lambda: ends.link.refused > 0)
    ends.link.send_readings(readings(1))
    assert eventually(lambda: [info.run for info in ends.infos[before:]][-1:] == ["run"])
    assert "an episode 'somebody-else' that is not this robot's is refused" in ends.told[0][1]
