"""Realtime over Zenoh: the robot does not wait, and nothing that dies makes it fall.

The clock runs slowly, so that planning fits on a busy machine.
"""

import signal
import time

import numpy as np
import pytest

pytestmark = [pytest.mark.slow, pytest.mark.alone, pytest.mark.timeout(180)]

SPEED = 0.3  # a planning period is 0.17 s of wall time
LIMIT = 1.0  # [s]: 20 plans
LONG = 60.0  # a limit that no test waits for [s]


@pytest.fixture(autouse=True)
def no_traceback(capfd):
    yield
    assert "Traceback" not in capfd.readouterr().err


@pytest.fixture
def start(robot_starts):
    def start(time_limit=LIMIT):
        return robot_starts(speed=SPEED, clock="realtime", time_limit=time_limit)

    return start


def robot_stood(system):
    heights = np.array(system.recording().states)[:, 2]
    return heights.min() > 0.4


def test_plans_come_on_time(start):
    system = start()
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    # Of the clock itself, without what came before it; a machine that is busy slips a little.
    assert 0.9 * SPEED < summary["real_time_factor"] < 1.02 * SPEED
    assert summary["plans"] >= 14
    assert 0 < summary["command_late_ms_p50"] < 20 / SPEED
    recording = system.recording()
    numbers = list(recording.plan_numbers)
    assert numbers == sorted(set(numbers))
    assert recording.plan_numbers[-1] >= 17
    assert robot_stood(system)


def test_a_worker_that_freezes_and_dies_costs_rollouts_and_nothing_else(start):
    system = start()
    system.after_plan(8)
    system.signal("local-0", signal.SIGSTOP)
    time.sleep(0.6)
    system.kill("local-0")
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    assert summary["rollouts_lost"] > 0
    assert summary["partial_plans"] > 0
    recording = system.recording()
    assert recording.plan_numbers[-1] >= 18
    assert min(recording.lost[-8:]) == 0  # the other worker has taken over
    assert robot_stood(system)


def test_without_workers_the_plan_goes_on_until_one_is_back(start, eventually):
    system = start(time_limit=LONG)
    system.after_plan(8)
    system.kill("local-0")
    system.kill("local-1")
    assert eventually(lambda: system.answered == 0, 30.0)
    system.start_again("local-0")
    assert eventually(lambda: system.answered > 0, 60.0)
    system.after_more_plans(3)
    system.interrupt()
    recording = system.recording()
    assert not np.isfinite(recording.costs[9:]).all()  # some plans had no rollouts
    assert np.isfinite(recording.costs[-1][: recording.rollouts[-1]]).all()
    assert robot_stood(system)


def test_without_an_optimizer_the_robot_follows_its_plan_and_then_stands(start):
    system = start(time_limit=1.6)
    system.after_plan(5)
    system.kill("optimizer")
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    recording = system.recording()
    assert recording.plan_numbers[-1] < 12
    states = np.array(recording.states)
    assert np.linalg.norm(states[-1, :2] - states[-10, :2]) < 0.05  # stands
    assert robot_stood(system)


def test_a_restarted_optimizer_goes_on(start):
    system = start(time_limit=LONG)
    system.after_plan(5)
    system.restart("optimizer")
    system.after_more_plans(10)
    system.interrupt()
    assert robot_stood(system)


def test_without_a_state_the_robot_sits_down(start):
    system = start(time_limit=3.0)
    system.after_plan(5)
    system.kill("state-estimator")
    code, summary = system.finish()
    assert code == 3
    assert summary["end_reason"].startswith("fault: no state for")
    assert summary["end_reason"].endswith("the robot sat down")
    states = np.array(system.recording().states)
    tilt = np.arccos(1 - 2 * (states[:, 4] ** 2 + states[:, 5] ** 2))  # of the base's z axis
    assert np.degrees(tilt).max() < 45  # it does not roll over on its way
    assert np.degrees(tilt[-1]) < 5
    assert states[-1, 2] < 0.3
    assert np.abs(states[-1, -31:]).max() < 1.0  # at rest, nearly


def test_waits_for_an_estimator_that_is_late(start):
    """A clock that started without it would make the robot sit down at once."""
    system = start(time_limit=0.3)
    system.restart("state-estimator")
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
