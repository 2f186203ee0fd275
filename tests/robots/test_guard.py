"""No command reaches the robot that is not within its limits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_dist.errors import UsageError
from sumo_dist.math.rotations import from_rotation_vector, multiply
from sumo_dist.model.scene import PLANT, Scene, compile_model
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.robots.safety import Safety, tilt
from sumo_dist.robots.spot import SPOT

STAND = np.array(SPOT.stand)
LOWER, UPPER = np.array(SPOT.safety.target_lower), np.array(SPOT.safety.target_upper)
STEP = np.array(SPOT.safety.target_rate) * 0.02
JOINTS = len(SPOT.joints)


@pytest.fixture(scope="module")
def model():
    return compile_model(Scene(SPOT), PLANT)


@pytest.fixture
def sent():
    return []


@pytest.fixture
def guard(model, sent):
    return CommandGuard(SPOT, model, sent.append, 0.02)


def test_limits_are_those_of_the_servos(model):
    np.testing.assert_allclose(model.actuator_ctrlrange[:, 0], LOWER, atol=1e-6)
    np.testing.assert_allclose(model.actuator_ctrlrange[:, 1], UPPER, atol=1e-6)


@pytest.mark.parametrize("pose", [SPOT.stand, SPOT.sit])
def test_the_robots_own_poses_are_within_its_limits(pose):
    assert (np.array(pose) >= LOWER).all() and (np.array(pose) <= UPPER).all()


def test_what_is_within_the_limits_passes_bit_for_bit(guard, sent):
    targets = STAND + 0.4 * STEP
    targets[-1] = -0.4 * STEP[-1]  # a closed gripper cannot close
    assert guard.send(targets)
    assert np.array_equal(sent[0], targets)
    assert guard.account() == {"sent": 1, "non-finite": 0, "position": 0, "rate": 0}


def test_what_is_not_finite_is_held_and_told(guard, sent):
    targets = STAND.copy()
    targets[3], targets[7] = np.nan, -np.inf
    assert not guard.send(targets)
    assert np.array_equal(sent[0], STAND)
    assert guard.account()["non-finite"] == 1


def test_each_cut_is_named(guard, sent):
    targets = STAND.copy()
    targets[0] = 5.0
    guard.send(targets)
    assert sent[-1][0] == UPPER[0]
    assert guard.account() == {"sent": 1, "non-finite": 0, "position": 1, "rate": 0}
    targets[:] = STAND
    targets[2] = STAND[2] + 1.2  # the limit of a step is 1.4 rad
    targets[13] += 0.7  # and here 0.6
    guard.send(targets)
    assert guard.account() == {"sent": 2, "non-finite": 0, "position": 1, "rate": 1}
    assert sent[-1][13] == pytest.approx(STAND[13] + STEP[13])


TARGETS = st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=JOINTS, max_size=JOINTS)


@settings(max_examples=100, deadline=None)
@given(sequence=st.lists(TARGETS, min_size=1, max_size=5))
def test_nothing_that_is_sent_is_beyond_a_limit(model, sequence):
    sent = [STAND]
    guard = CommandGuard(SPOT, model, sent.append, 0.02)
    for targets in sequence:
        guard.send(np.array(targets))
    commands = np.array(sent)
    assert np.isfinite(commands).all()
    assert (commands >= LOWER).all() and (commands <= UPPER).all()
    assert (np.abs(np.diff(commands, axis=0)) <= STEP * (1 + 1e-12)).all()


def test_a_robot_that_states_no_limits_has_those_of_its_servos(model, sent):
    guard = CommandGuard(replace(SPOT, safety=Safety()), model, sent.append, 0.02)
    guard.send(np.full(JOINTS, 9.0))
    assert np.array_equal(sent[0], model.actuator_ctrlrange[:, 1])


def test_limits_for_another_number_of_joints_are_refused(model, sent):
    short = replace(SPOT, safety=Safety(target_rate=(1.0, 2.0)))
    with pytest.raises(UsageError, match="target_rate has 2 numbers for 19 joints"):
        CommandGuard(short, model, sent.append, 0.02)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.5, 3.0])
def test_tilt_is_the_angle_from_level_whatever_the_heading(angle):
    heading = from_rotation_vector(np.array([0.0, 0.0, 2.0]))
    state = np.zeros(10)
    state[3:7] = multiply(heading, from_rotation_vector(np.array([0.0, angle, 0.0])))
    assert tilt(state) == pytest.approx(angle, abs=1e-7)
