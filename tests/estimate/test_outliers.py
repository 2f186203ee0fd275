"""Motion capture that swaps markers, and a body that really jumped."""

import dataclasses

import numpy as np
import pytest

from sumo_dist.errors import SumoError
from sumo_dist.estimate import LowPassEstimator

BOX = 1  # among the free bodies


def follow(estimate, motion, ticks, change=lambda readings: readings):
    for tick in ticks:
        state = estimate(change(motion.readings(tick)))
    return state


def displaced(readings, by=(0.4, 0.0, 0.0), frames=slice(None)):
    mocap = readings.mocap.copy()
    mocap[frames, BOX, :3] += by
    return dataclasses.replace(readings, mocap=mocap)


def test_a_stray_pose_changes_nothing(model, motion):
    estimate = LowPassEstimator(model)
    follow(estimate, motion, range(1, 51))
    state = estimate(displaced(motion.readings(51), frames=slice(0, 1)))
    np.testing.assert_allclose(state, motion.state(51), atol=1e-9)
    np.testing.assert_allclose(follow(estimate, motion, range(52, 60)), motion.state(59), atol=1e-9)
    assert estimate.outliers == 1


def test_the_other_body_is_still_seen(model, motion):
    estimate = LowPassEstimator(model)
    follow(estimate, motion, range(1, 51))
    rng = np.random.default_rng(0)
    state = follow(
        estimate,
        motion,
        range(51, 55),
        lambda readings: displaced(readings, rng.uniform(0.3, 5.0, 3)),
    )
    np.testing.assert_allclose(state, motion.state(54), atol=1e-9)  # the box by its velocity
    assert estimate.outliers >= 8


def test_strays_without_end_are_no_state(model, motion):
    estimate, rng = LowPassEstimator(model), np.random.default_rng(0)
    follow(estimate, motion, range(1, 51))
    with pytest.raises(SumoError, match="a body's pose is off for 1"):
        follow(
            estimate,
            motion,
            range(51, 60),
            lambda readings: dataclasses.replace(
                readings, mocap=readings.mocap + rng.uniform(1, 9, readings.mocap.shape)
            ),
        )


def test_a_body_that_jumped_is_followed_to_its_new_place(model, motion):
    estimate = LowPassEstimator(model)
    follow(estimate, motion, range(1, 51))
    state = follow(estimate, motion, range(51, 80), displaced)
    pose = motion.index.pose("box")
    expected = motion.state(79)[pose][:3] + np.array([0.4, 0.0, 0.0])
    np.testing.assert_allclose(state[pose][:3], expected, atol=0.02)


def test_a_stray_first_pose_is_forgotten(model, motion):
    estimate = LowPassEstimator(model)
    estimate(displaced(motion.readings(1), (3.0, 0.0, 0.0)))
    state = follow(estimate, motion, range(2, 40))
    pose = motion.index.pose("box")
    np.testing.assert_allclose(state[pose][:3], motion.state(39)[pose][:3], atol=5e-3)
