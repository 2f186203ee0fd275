"""Spot walks on the estimated state, on a plant that sends packets."""

import dataclasses

import numpy as np
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.estimate import make_estimator
from sumo_dist.math.rotations import (
    conjugate,
    from_rotation_vector,
    multiply,
    rotate_inverse,
    to_rotation_vector,
)
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.plant.simulated import Plant
from sumo_dist.policies import load_policy
from sumo_dist.robots.spot import SPOT
from sumo_dist.tasks import load_task

WALK, TURN = (0.5, 0.0, 0.0), (0.3, 0.0, 0.5)  # vx, vy [m/s], wz [rad/s]


def far_from_the_box(task):
    state, index = draw_start(task, seed=0), StateIndex(compile_model(task.scene, PLANT))
    state[index.pose("body")][:2] = 0.0
    state[index.pose("box")][:2] = 10.0
    return state


def noisy(readings, rng, position, rotation):
    """Add noise to every mocap frame: standard deviations [m] and [rad], per axis."""
    mocap = readings.mocap.copy()
    mocap[..., :3] += position * rng.standard_normal(mocap[..., :3].shape)
    turn = from_rotation_vector(rotation * rng.standard_normal(mocap[..., :3].shape))
    mocap[..., 3:] = multiply(mocap[..., 3:], turn)
    return dataclasses.replace(readings, mocap=mocap)


def walk(velocity, noise):
    """5 s: true states and estimates of every tick, (250, nq + nv) each."""
    task = load_task("spot/move_box")
    plant = Plant(task.scene, far_from_the_box(task), "lowpass")
    estimate, policy = make_estimator("lowpass", plant.model), load_policy("spot")
    command, memory = np.array(SPOT.default_command), policy.initial_memory()
    command[:3] = velocity
    rng, states, estimates, nq = np.random.default_rng(0), [], [], plant.model.nq
    for _ in range(250):
        seen = estimate(noisy(plant.read(), rng, *noise))
        states.append(plant.truth)
        estimates.append(seen)
        targets, memory = policy.step(seen[:nq], seen[nq:], command, memory)
        plant.send(targets)
        plant.advance()
    return StateIndex(plant.model), np.array(states), np.array(estimates)


def rms(errors):
    return np.sqrt(np.mean(np.sum(np.square(errors), axis=-1)))


@pytest.mark.parametrize(
    ("velocity", "noise", "limits"),
    [
        (WALK, (0.0, 0.0), (0.4e-3, 2e-3, 0.05, 0.25)),
        (TURN, (0.5e-3, 2e-3), (1.6e-3, 7e-3, 0.10, 0.50)),
    ],
    ids=["walk", "turn with noise"],
)
def test_spot_walks_on_the_estimate(velocity, noise, limits):
    """No fall; mean velocity within 0.1 m/s and 0.2 rad/s of the command; errors within limits.

    The limits are twice what was measured: position [m], attitude [rad], velocity [m/s], rate of
    rotation [rad/s].
    """
    index, states, estimates = walk(velocity, noise)
    pose, speed = index.pose("body"), index.velocity("body")
    assert states[:, pose][:, 2].min() > 0.45

    steady = states[100:]
    linear = rotate_inverse(steady[:, pose][:, 3:], steady[:, speed][:, :3]).mean(axis=0)
    assert np.abs(linear[:2] - velocity[:2]).max() < 0.1
    assert abs(steady[:, speed][:, 5].mean() - velocity[2]) < 0.2

    seen = estimates[100:]
    turned = multiply(conjugate(steady[:, pose][:, 3:]), seen[:, pose][:, 3:])
    off = steady - seen
    errors = (off[:, pose][:, :3], to_rotation_vector(turned), *np.split(off[:, speed], 2, axis=1))
    for error, limit in zip(errors, limits, strict=True):
        assert rms(error) < limit
