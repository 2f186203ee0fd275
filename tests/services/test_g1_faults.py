"""Faults of a robot on two legs: what is lost costs rollouts, plans or time, and a state the robot.

Spot's tests of the same are in test_realtime, test_stops and test_lockstep; here is what must hold
for G1 too, and what differs: its safe stop is a fall, after which it stays down.
"""

import numpy as np
import pytest

from sumo_dist.cli import main
from sumo_dist.robots.g1 import G1
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.notices import Health

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]
alone = pytest.mark.alone

TASK = "g1/box_push"
SPEED = 0.3  # slow enough for a busy machine
SPEED_OF_STOPS = 0.8  # they take seconds of robot time
DOWN = 0.3  # a pelvis below this lies on the floor [m]


@pytest.fixture(autouse=True)
def no_traceback(capfd):
    yield
    assert "Traceback" not in capfd.readouterr().err


@pytest.fixture
def start(robot_starts):
    def start(speed=SPEED, time_limit=20.0, **changes):
        return robot_starts(TASK, speed=speed, clock="realtime", time_limit=time_limit, **changes)

    return start


def states(system):
    recorded = np.array(system.recording().states)
    assert np.isfinite(recorded).all()
    return recorded


def assert_it_lies_at_rest(system):
    recorded = states(system)
    assert recorded[-1, 2] < DOWN
    moved = np.abs(recorded[-1, :3] - recorded[-10, :3])
    assert moved.max() < 0.1  # in 0.2 s
    targets = np.array(system.recording().targets)
    np.testing.assert_allclose(targets[-1], G1.sit, atol=1e-9)
    step = np.abs(np.diff(targets, axis=0)) / 0.02
    assert (step <= np.array(G1.safety.target_rate) + 1e-6).all()


@alone
def test_it_stands_without_workers_or_plans_and_goes_on_when_they_are_back(start):
    system = start(time_limit=60.0)
    system.after_plan(4)
    system.kill("local-1")
    system.restart("local-0", pause=0.5)
    system.after_plan(12)
    system.restart("optimizer", pause=3.0)  # 0.9 s of robot time: the plan of 0.4 s runs out
    system.after_more_plans(8)
    summary = system.interrupt()
    recording = system.recording()
    gap = int(np.argmax(np.diff(recording.plan_ticks)))
    left, back = recording.plan_ticks[gap : gap + 2]
    assert back - left > 25
    recorded = states(system)
    standing = recorded[back - 10 : back, :2]
    assert np.linalg.norm(standing[-1] - standing[0]) < 0.08  # in 0.2 s
    assert len(recording.plan_numbers) > gap + 5  # plans came back
    assert recorded[:, 2].min() > G1.fall_height
    assert summary["commands"]["non-finite"] == 0
    # The arms follow the plan itself: only where it returns may the guard have to soften a step.
    step = np.abs(np.diff(recording.targets, axis=0)) / 0.02
    softened = 1 + np.flatnonzero((step > np.array(G1.safety.target_rate) - 1e-6).any(axis=1))
    assert summary["commands"]["rate"] == len(softened)
    assert all(back <= tick <= back + 3 for tick in softened)


@alone
@pytest.mark.parametrize("lost", ["state-estimator", "router"])
def test_without_a_state_it_falls_and_comes_to_rest(start, lost):
    """No leg can balance blind, and states come by the router too."""
    system = start(speed=SPEED_OF_STOPS)
    system.after_plan(4)
    system.kill(lost)
    if lost == "router":
        system.start_again(lost)
    code, summary = system.finish()
    assert code == 3
    assert summary["end_reason"].startswith("fault: no state for")
    assert_it_lies_at_rest(system)


@alone
def test_an_emergency_stop_is_final(start, capfd, eventually):
    system = start(speed=SPEED_OF_STOPS, resume_wait=6.0)
    where = ["--connect", system.endpoint, "--robot", "g1"]
    with Bus.dial(system.endpoint, "g1") as bus:
        health = bus.newest(Health, address="robot")
        system.after_plan(5)
        assert main(["stop", *where, "--reason", "a test"]) == 0
        assert eventually(lambda: health.peek() and health.peek().mode == "stopped", 30.0)
        assert main(["resume", *where]) == 3
        assert health.peek().mode == "stopped"
    code, summary = system.finish()
    assert code == 3
    assert summary["end_reason"].endswith(": a test, the robot sat down")
    assert (
        "sumo-dist: g1 refuses to stand: cannot go on: it cannot get up by itself"
        in capfd.readouterr().err
    )
    assert_it_lies_at_rest(system)
