"""Realtime faults of a robot on two legs: what is lost costs rollouts or plans, not the robot."""

import numpy as np
import pytest

from sumo_dist.robots.g1 import G1

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

SPEED = 0.3  # slow enough for a busy machine


@pytest.fixture
def start(run_system):
    def start(workers, time_limit):
        return run_system(
            workers, speed=SPEED, clock="realtime", time_limit=time_limit, task="g1/box_push"
        )

    return start


def heights(system):
    return np.array(system.recording().states)[:, 2]


def test_without_workers_and_then_without_an_optimizer_it_stays_up(start):
    system = start(workers=1, time_limit=2.4)
    system.after_plan(4)
    system.restart("local-0", pause=0.5)
    system.after_plan(12)
    system.kill("optimizer")
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    assert system.recording().plan_numbers[-1] < 24
    assert heights(system).min() > G1.fall_height


def test_without_a_state_it_sinks_and_comes_to_rest(start):
    """No leg can balance blind: the joints ramp to a squat, and the robot ends on the floor."""
    system = start(workers=1, time_limit=4.0)
    system.after_plan(4)
    system.kill("state-estimator")
    code, summary = system.finish()
    assert code == 3
    assert summary["end_reason"].startswith("fault: no state for")
    states = np.array(system.recording().states)
    assert np.isfinite(states).all()
    assert states[-1, 2] < G1.fall_height
