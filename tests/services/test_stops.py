"""Safe stops over Zenoh: by people and by faults, and the way back."""

import threading
import time

import numpy as np
import pytest

from sumo_dist.cli import main
from sumo_dist.commands import orders
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.robots.spot import SPOT
from sumo_dist.timing import anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import Health, PlanMessage

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

SPEED = 0.8  # of the wall clock: stops take seconds of robot time
LONG = 60.0  # a limit that no test waits for [s]


@pytest.fixture(autouse=True)
def no_traceback(capfd):
    yield
    assert "Traceback" not in capfd.readouterr().err


def give(action, endpoint, capfd):
    code = main([action, "--connect", endpoint, "--reason", "a test"])
    return code, capfd.readouterr().out


def heights(system):
    return np.array(system.recording().states)[:, 2]


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_stop_makes_the_robot_sit_and_ends_the_run(run_system, endpoint, capfd, clock):
    speed = SPEED if clock == "realtime" else None
    system = run_system(speed=speed, clock=clock, time_limit=20.0)
    system.after_plan(5)
    code, said = give("stop", endpoint, capfd)
    assert (code, said[:9]) == (0, "spot: sto")
    code, summary = system.finish(timeout=20.0)
    assert code == 3
    assert summary["end_reason"].startswith("stopped by ")
    assert summary["end_reason"].endswith(": a test, the robot sat down")
    assert heights(system)[-1] < 0.3
    legs = system.recording().states[-1][7:19]
    assert np.abs(legs - np.array(SPOT.sit)[:12]).max() < 0.3
    assert abs(summary["commands"]["sent"] - len(system.recording().states)) <= 1
    assert summary["commands"]["non-finite"] == 0


def mode(health):
    """What the robot said last; None before it spoke."""
    return message.mode if (message := health.peek()) else None


def test_it_goes_on_only_when_it_is_told_to(run_system, endpoint, capfd, eventually):
    system = run_system(speed=SPEED, clock="realtime", time_limit=LONG, resume_wait=30.0)
    with Bus.dial(endpoint, "spot") as bus:
        health = bus.newest(Health, address="robot")
        system.after_plan(5)
        assert give("stop", endpoint, capfd)[0] == 0
        assert eventually(lambda: mode(health) == "stopped", 10.0)
        time.sleep(0.6)
        assert mode(health) == "stopped"  # plans alone do not make it move
        assert give("resume", endpoint, capfd)[0] == 0
        assert eventually(lambda: mode(health) == "running", 10.0)
        system.after_more_plans(30)  # 1.5 s: the policy lifts what the servos cannot
    system.interrupt()
    z = heights(system)
    assert z.min() < 0.3 < 0.45 < z[-1]


def test_a_robot_that_lost_its_state_does_not_rise_without_one(run_system, endpoint, eventually):
    system = run_system(speed=SPEED, clock="realtime", time_limit=LONG, resume_wait=60.0)
    with Bus.dial(endpoint, "spot") as bus:
        health = bus.newest(Health, address="robot")
        system.after_plan(5)
        system.kill("state-estimator")
        assert eventually(lambda: mode(health) == "stopped", 10.0)

        def insist():
            while main(["resume", "--connect", endpoint]) != 0:
                pass  # a state takes as long as a process takes to start

        order = threading.Thread(target=insist, daemon=True)
        order.start()
        time.sleep(1.0)
        assert mode(health) == "stopped"  # it was told to, and cannot
        system.start_again("state-estimator")
        assert eventually(lambda: mode(health) == "running", 30.0)
        order.join(10.0)
        system.after_more_plans(5)
    system.interrupt()


def test_plans_of_another_robot_are_refused(run_system, endpoint, eventually):
    system = run_system(speed=SPEED, clock="realtime", time_limit=1.0)
    run = system.run_id
    with Bus.dial(endpoint, "spot") as bus:
        health = bus.newest(Health, address="robot")
        system.after_plan(5)
        knots = np.zeros((4, 25), np.float32)
        plan = Plan(10_000, anchor_tick(10_000), knots, 0.4, "linear")
        report = PlanReport(plan, np.zeros(1), np.ones(1, bool), np.zeros(1), 1.0, 1.0)

        def refused():
            bus.publish(PlanMessage.of(run, report))
            time.sleep(0.1)
            return health.peek() and health.peek().counters["refused"] > 0

        assert eventually(refused, 10.0)
    code, summary = system.finish(timeout=30.0)
    assert (code, summary["end_reason"]) == (1, "timeout")
    assert max(system.recording().plan_numbers) < 10_000
    assert heights(system).min() > 0.4


def test_nobody_to_stop_is_said(router, capfd, monkeypatch):
    monkeypatch.setattr(orders, "PATIENCE_S", 0.5)
    assert main(["stop", "--connect", router, "--robot", "nobody"]) == 3
    assert "nobody did not stop within 0.5 s: it says nothing" in capfd.readouterr().err
