"""The robot's side of the bus; the other side is scripted."""

import threading
import time
from contextlib import ExitStack

import numpy as np
import pytest

from sumo_dist.dispatch import robot_link
from sumo_dist.dispatch.robot_link import RobotLink
from sumo_dist.errors import Interrupted, SumoError
from sumo_dist.estimate.readings import Readings
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.timing import anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import PlanMessage, Sensors, State, Status

MEMORY = np.zeros(12, np.float32)


def readings(tick):
    none = np.empty(0, np.int64)
    return Readings(
        tick, np.full(64, float(tick)), none, np.empty((0, 38)), none, np.empty((0, 2, 7))
    )


def plan_message(number, tick=None, run="run"):
    tick = anchor_tick(number) if tick is None else tick
    plan = Plan(number, tick, np.full((4, 9), 0.1, np.float32), 1.5, "linear")
    report = PlanReport(plan, np.zeros(3), np.ones(3, bool), np.zeros(3), 1.0, 1.0)
    return PlanMessage.of(run, report)


def plan_request(number):
    return PlanRequest(number, anchor_tick(number), np.zeros(64), MEMORY, None)


class Ends:
    """The robot's link and a bus at the other end."""

    def __init__(self, stack, endpoint, robot, wait=5.0):
        self.told, self.seen, self.stop = [], [], threading.Event()
        self.other = stack.enter_context(Bus.dial(endpoint, robot))
        bus = stack.enter_context(Bus.dial(endpoint, robot, run="run"))
        self.link = RobotLink(
            bus, "run", wait, self.stop, lambda *told: self.told.append(told), self.seen.append
        )
        self.meet()

    def meet(self):
        """Speak until heard: what is said before the router knows both ends is lost."""
        deadline = time.monotonic() + 5.0
        while not self.seen:
            assert time.monotonic() < deadline, "the link hears nothing"
            self.other.publish(plan_message(1000))
            time.sleep(0.05)
        time.sleep(0.1)  # for what was said twice
        self.seen.clear()
        self.link.new_plans()


@pytest.fixture
def ends(router, robot):
    with ExitStack() as stack:
        yield Ends(stack, router, robot)


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

    def second_time(status):
        asked.append((status.tick, status.wanted, status.clock))
        if len(asked) == 2:
            for number in (3, 5, 4):
                ends.other.publish(plan_message(number))

    ends.other.subscribe(Status, second_time)
    report = ends.link.ask_plan(readings(10), plan_request(4))
    assert (report.plan.number, report.plan.tick) == (4, 10)
    assert asked == [(10, 4, "lockstep")] * 2


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
    assert 0.09 < time.monotonic() - began < 0.5
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


def test_gives_up_with_a_reason_when_nobody_answers(router, robot, monkeypatch):
    monkeypatch.setattr(robot_link, "NOTICE_S", 0.3)
    with ExitStack() as stack:
        ends = Ends(stack, router, robot, wait=0.6)
        with pytest.raises(SumoError, match=r"no answer to the request for a plan in 0\.6 s"):
            ends.link.ask_plan(readings(0), plan_request(0))
        with pytest.raises(SumoError, match=r"no answer to the request for a state in 0\.6 s"):
            ends.link.ask_state(readings(0))
        assert [text for _, text in ends.told] == ["waiting for a plan", "waiting for a state"]


def test_ends_its_waiting_when_told_to_stop(ends):
    threading.Timer(0.2, ends.stop.set).start()
    with pytest.raises(Interrupted):
        ends.link.ask_state(readings(0))
