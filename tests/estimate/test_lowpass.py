import dataclasses

import numpy as np
import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.estimate import LowPassConfig, LowPassEstimator
from sumo_dist.robots.spot import SPOT


def follow(estimate, motion, ticks, change=lambda readings: readings):
    """Estimate of the last tick."""
    for tick in ticks:
        state = estimate(change(motion.readings(tick)))
    return state


def without_mocap(readings):
    return dataclasses.replace(readings, mocap_ms=readings.mocap_ms[:0], mocap=readings.mocap[:0])


def align(state, truth, index):
    """Give the quaternions of a state the signs of the true ones."""
    state = state.copy()
    for body in index.free_bodies:
        quat = slice(index.pose(body).start + 3, index.pose(body).stop)
        state[quat] *= np.sign(state[quat] @ truth[quat])
    return state


@pytest.mark.parametrize("last", [50, 51, 52, 53, 54])  # mocap frames 0 to 7 ms before the tick
def test_constant_velocities_do_not_lag(model, motion, last):
    state = follow(LowPassEstimator(model), motion, range(1, last + 1))
    np.testing.assert_allclose(state, motion.state(last), atol=1e-9)


def test_a_delayed_frame_is_moved_on_to_the_tick(model, motion):
    """Several times nearer than the frame itself, even though noise blurs the velocity."""
    rng, body = np.random.default_rng(3), motion.index.pose("body")
    moved, held = [], []

    def delayed(readings):
        stamps = readings.mocap_ms - 20
        noise = 0.0005 * rng.standard_normal((len(stamps), 2, 3))
        frames = np.array([motion.poses(stamp) for stamp in stamps])
        frames[..., :3] += noise
        return dataclasses.replace(readings, mocap_ms=stamps, mocap=frames)

    estimate = LowPassEstimator(model)
    for tick in range(2, 200):
        readings, truth = delayed(motion.readings(tick)), motion.state(tick)[body][:3]
        moved.append(estimate(readings)[body][:3] - truth)
        held.append(readings.mocap[-1, 0, :3] - truth)
    assert 5 * np.linalg.norm(moved[50:]) < np.linalg.norm(held[50:])


def test_the_sign_of_a_measured_quaternion_does_not_matter(model, motion):
    rng = np.random.default_rng(0)

    def flip(readings):
        mocap = readings.mocap.copy()
        mocap[..., 3:] *= rng.choice([-1.0, 1.0], (*mocap.shape[:2], 1))
        return dataclasses.replace(readings, mocap=mocap)

    state = follow(LowPassEstimator(model), motion, range(1, 51), flip)
    truth = motion.state(50)
    np.testing.assert_allclose(align(state, truth, motion.index), truth, atol=1e-9)


def test_it_starts_where_the_first_packets_are_with_the_bodies_at_rest(model, motion):
    first = motion.readings(5)
    first = dataclasses.replace(first, mocap_ms=np.array([100]), mocap=motion.poses(100)[None])
    state, truth = LowPassEstimator(model)(first), motion.state(5)
    for body in motion.index.free_bodies:
        truth[motion.index.velocity(body)] = 0.0
    np.testing.assert_allclose(state, truth, atol=1e-12)


def test_the_first_packets_must_come_from_both_sensors(model, motion):
    with pytest.raises(SumoError, match="no motion capture packet yet"):
        LowPassEstimator(model)(without_mocap(motion.readings(1)))


def test_a_short_gap_is_bridged_at_the_last_velocity(model, motion):
    estimate = LowPassEstimator(model)
    follow(estimate, motion, range(1, 51))
    np.testing.assert_allclose(
        follow(estimate, motion, range(51, 56), without_mocap), motion.state(55), atol=1e-9
    )
    np.testing.assert_allclose(follow(estimate, motion, range(56, 58)), motion.state(57), atol=1e-9)


def test_after_a_long_gap_there_is_no_estimate_until_packets_return(model, motion):
    estimate = LowPassEstimator(model)
    follow(estimate, motion, range(1, 51))
    with pytest.raises(SumoError, match="no motion capture packet for 120 ms"):
        follow(estimate, motion, range(51, 57), without_mocap)
    np.testing.assert_allclose(estimate(motion.readings(57)), motion.state(57), atol=1e-9)


def test_late_repeated_and_future_packets_are_left_out(model, motion):
    def disturb(readings):
        wrong = np.full_like(readings.mocap[:1], 0.5)
        stamps = [[readings.mocap_ms[0] - 9], readings.mocap_ms, readings.mocap_ms[-1:]]
        mocap = [wrong, readings.mocap, wrong, wrong]
        late = [*stamps, [readings.tick * 20 + 1]]
        return dataclasses.replace(
            readings, mocap_ms=np.concatenate(late), mocap=np.concatenate(mocap)
        )

    undisturbed, disturbed = LowPassEstimator(model), LowPassEstimator(model)
    follow(undisturbed, motion, [1])
    follow(disturbed, motion, [1])
    np.testing.assert_array_equal(
        follow(disturbed, motion, range(2, 20), disturb), follow(undisturbed, motion, range(2, 20))
    )


def test_a_step_is_answered_as_by_a_first_order_filter(model, motion):
    """1 - exp(-2 pi f t), the continuous filter's answer, however the packets are spaced."""
    estimate = LowPassEstimator(model, LowPassConfig(joint_velocity_hz=7.0))
    motion.joint_rates = np.zeros(19)
    follow(estimate, motion, range(1, 3))  # the last encoder packet is from 39 ms
    motion.joint_rates = np.ones(19)
    _, velocities = motion.index.joints(SPOT.joints)
    state = follow(estimate, motion, range(3, 7))  # and now from 120 ms
    np.testing.assert_allclose(state[velocities], 1 - np.exp(-2 * np.pi * 7.0 * 0.081))


def test_a_lower_cut_off_takes_out_more_noise(model, motion):
    motion.linear = motion.angular = np.zeros((2, 3))
    velocity = motion.index.velocity("body")

    def speed_error(hz):
        rng, errors = np.random.default_rng(1), []
        estimate = LowPassEstimator(model, LowPassConfig(linear_velocity_hz=hz))
        for tick in range(1, 200):
            readings = motion.readings(tick)
            mocap = readings.mocap.copy()
            mocap[..., :3] += 0.0005 * rng.standard_normal(mocap[..., :3].shape)
            errors.append(estimate(dataclasses.replace(readings, mocap=mocap))[velocity][:3])
        return np.sqrt(np.mean(np.square(errors[20:])))

    unfiltered = np.sqrt(2) * 0.0005 * 120  # of the differences of two noisy frames [m/s]
    assert speed_error(1000.0) == pytest.approx(unfiltered, rel=0.1)
    assert speed_error(10.0) < 0.5 * unfiltered
    assert speed_error(3.0) < 0.5 * speed_error(10.0)


def test_packets_of_another_scene_are_refused(model, motion):
    readings = motion.readings(1)
    with pytest.raises(SumoError, match=r"motion capture packets of shape \(1, 7\).*\(2, 7\)"):
        LowPassEstimator(model)(dataclasses.replace(readings, mocap=readings.mocap[:, :1]))
    with pytest.raises(SumoError, match=r"encoder packets of shape \(36,\).*\(38,\)"):
        LowPassEstimator(model)(dataclasses.replace(readings, encoders=readings.encoders[:, :36]))


@pytest.mark.parametrize("value", [0.0, -5.0, float("nan"), float("inf")])
def test_a_cut_off_must_be_positive(value):
    with pytest.raises(UsageError, match="position_hz must be positive"):
        LowPassConfig(position_hz=value)
