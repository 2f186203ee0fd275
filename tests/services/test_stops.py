"""Safe stops over Zenoh: by people and by faults, and the way back."""

import threading
import time

import numpy as np
import pytest

from sumo_dist.cli import main
from sumo_dist.dispatch import commander
from sumo_dist.robots.spot import SPOT
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.notices import Health

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]
alone = pytest.mark.alone

SPEED = 0.8  # of the wall clock: stops take seconds of robot time
LONG = 60.0  # a limit that no test waits for [s]


@pytest.fixture(autouse=True)
def no_traceback(capfd):
    yield
    assert "Traceback" not in capfd.readouterr().err


def give(action, system, capfd):
    """Give a command by `sumo-dist stop` or `resume`; return exit code and what was said."""
    reason = ["--reason", "a test"] if action == "stop" else []
    code = main([action, "--connect", system.endpoint, *reason])
    return code, capfd.readouterr().out


def heights(system):
    return np.array(system.recording().states)[:, 2]


@pytest.mark.parametrize("clock", ["lockstep", pytest.param("realtime", marks=alone)])
def test_stop_makes_the_robot_sit_and_ends_the_run(robot_starts, capfd, clock):
    speed = SPEED if clock == "realtime" else None
    system = robot_starts(speed=speed, clock=clock, time_limit=20.0)
    system.after_plan(5)
    code, said = give("stop", system, capfd)
    assert (code, said.rpartition(" ")[0]) == (0, "spot: stop at tick")
    code, summary = system.finish()
    assert code == 3
    assert summary["end_reason"].startswith("stopped by ")
    assert summary["end_reason"].endswith(": a test, the robot sat down")
    assert heights(system)[-1] < 0.3
    legs = system.recording().states[-1][7:19]
    assert np.abs(legs - np.array(SPOT.sit)[:12]).max() < 0.3
    assert abs(summary["commands"]["sent"] - len(system.recording().states)) <= 1
    assert summary["commands"]["non-finite"] == 0
    (command,) = system.recording().operator
    assert (command["verb"], command["value"]) == ("stop", "a test")


@pytest.mark.parametrize("lost", [("local-0", "local-1"), ("state-estimator",)])
def test_a_stop_is_obeyed_while_the_robot_waits_for_an_answer(robot_starts, capfd, lost):
    """In lockstep it would wait for a plan or a state as long as it takes."""
    system = robot_starts(time_limit=20.0, wait=600.0)
    system.after_plan(5)
    for name in lost:
        system.kill(name)
    time.sleep(0.5)
    assert give("stop", system, capfd)[0] == 0
    code, summary = system.finish()
    assert code == 3
    assert summary["end_reason"].endswith(": a test, the robot sat down")
    assert heights(system)[-1] < 0.3


@alone
def test_a_stop_before_the_clock_starts_is_obeyed(run_system, capfd):
    """While it calibrates, or waits for somebody to plan at all."""
    system = run_system(workers=0, clock="realtime", time_limit=20.0, wait=600.0)
    deadline = time.monotonic() + 60.0
    while system.number == 0:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert give("stop", system, capfd)[0] == 0
    code, summary = system.finish()
    assert code == 3
    assert summary["end_reason"].endswith(": a test, the robot sat down")


def mode(health):
    """What the robot said last; None before it spoke."""
    return message.mode if (message := health.peek()) else None


@alone
def test_it_goes_on_only_when_it_is_told_to(robot_starts, capfd, eventually):
    system = robot_starts(speed=SPEED, clock="realtime", time_limit=LONG, resume_wait=30.0)
    with Bus.dial(system.endpoint, "spot") as bus:
        health = bus.newest(Health, address="robot")
        system.after_plan(5)
        assert give("stop", system, capfd)[0] == 0
        assert eventually(lambda: mode(health) == "stopped", 30.0)
        time.sleep(0.6)
        assert mode(health) == "stopped"  # plans alone do not make it move
        assert give("resume", system, capfd)[0] == 0
        assert eventually(lambda: mode(health) == "running", 60.0)
        system.after_more_plans(30)  # 1.5 s: the policy lifts what the servos cannot
    system.interrupt()
    z = heights(system)
    assert z.min() < 0.3 < 0.45 < z[-1]


@alone
def test_a_robot_that_lost_its_state_does_not_rise_without_one(robot_starts, eventually):
    system = robot_starts(speed=SPEED, clock="realtime", time_limit=LONG, resume_wait=60.0)
    with Bus.dial(system.endpoint, "spot") as bus:
        health = bus.newest(Health, address="robot")
        system.after_plan(5)
        system.kill("state-estimator")
        assert eventually(lambda: mode(health) == "stopped", 30.0)

        def insist():
            while main(["resume", "--connect", system.endpoint]) != 0:
                pass  # a state takes as long as a process takes to start

        order = threading.Thread(target=insist, daemon=True)
        order.start()
        time.sleep(1.0)
        assert mode(health) == "stopped"  # it was told to, and cannot
        system.start_again("state-estimator")
        assert eventually(lambda: mode(health) == "running", 60.0)
        order.join(10.0)
        system.after_more_plans(5)
    system.interrupt()


@alone
def test_while_it_sits_it_is_told_to_stand_first(robot_starts, capfd, eventually):
    """And of all that it was told, only what was carried out is recorded."""
    system = robot_starts(speed=SPEED, clock="realtime", time_limit=LONG, resume_wait=60.0)
    with Bus.dial(system.endpoint, "spot") as bus:
        health = bus.newest(Health, address="robot")
        system.after_plan(5)
        assert system.command("pause").refusal == ""
        assert eventually(lambda: mode(health) == "paused", 30.0)
        assert system.command("stop", value="smoke").refusal == ""  # a pause does not hinder it
        assert eventually(lambda: mode(health) == "stopped", 30.0)
        for verb, name, value in (
            ("weight", "goal", "70"),
            ("reset", "", ""),
            ("pause", "", ""),
            ("task", "spot/move_tire", ""),
        ):
            refusal = system.command(verb, name, value).refusal
            assert refusal == "the robot has stopped: let it stand first"
        assert system.command("stop").refusal == ""
        assert system.command("stand").refusal == ""
        assert eventually(lambda: mode(health) == "paused", 60.0)  # as it was before
        assert system.command("resume").refusal == ""
        assert eventually(lambda: mode(health) == "running", 60.0)
        system.after_more_plans(3)
    system.interrupt()
    assert system.episodes == 1
    assert heights(system).min() < 0.3


def test_nobody_to_stop_is_said(router, capfd, monkeypatch):
    monkeypatch.setattr(commander, "PATIENCE_S", 0.5)
    assert main(["stop", "--connect", router, "--robot", "nobody"]) == 3
    said = capfd.readouterr().err
    assert f"nobody did not answer within 0.5 s: it is not at {router}" in said
