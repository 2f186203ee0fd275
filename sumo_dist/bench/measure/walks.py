"""Walks of Spot on its estimated state, and how far the estimates are off, by channel."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from sumo_dist.episode.assemble import draw_start
from sumo_dist.errors import SumoError
from sumo_dist.estimate import LowPassConfig, LowPassEstimator
from sumo_dist.math.rotations import conjugate, multiply, to_rotation_vector
from sumo_dist.model.index import StateIndex
from sumo_dist.plant.noise import PlantProfile
from sumo_dist.plant.simulated import Plant
from sumo_dist.policies import load_policy
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.robots.spot import SPOT
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK

TASK = "spot/move_box"
SETTLE_S = 1.0  # not counted: the filters start at rest
VELOCITIES = {"push": (0.5, 0.0, 0.0), "turn": (0.3, 0.0, 0.5)}  # vx, vy [m/s], wz [rad/s]
BOX_AHEAD = {"push": 1.1, "turn": 10.0}  # distance of the box from the robot [m]


class Errors(NamedTuple):
    """Root mean square over time of each channel's error vector."""

    base_mm: float
    base_mrad: float
    base_m_s: float
    base_rad_s: float
    joints_mrad: float
    joints_rad_s: float
    box_mm: float
    box_mrad: float
    box_m_s: float
    box_rad_s: float


@dataclass(frozen=True)
class Walk:
    """One walk, tick by tick.

    Attributes:
        model: the plant's.
        states: (T, nq + nv) what was true.
        estimates: (T, nq + nv) what the policy acted on.
        outliers: poses that the estimator left out.
        reason: "" if it walked to the end, else why not.
    """

    model: mujoco.MjModel
    states: np.ndarray
    estimates: np.ndarray
    outliers: int
    reason: str

    def errors(self) -> Errors | None:
        """Compare the estimates with the truth; None if the walk ended before it counts."""
        first = round(SETTLE_S / TICK)
        if len(self.states) <= first:
            return None
        return errors_of(StateIndex(self.model), self.states[first:], self.estimates[first:])


def walk(
    motion: str, profile: PlantProfile, seed: int, seconds: float, config: LowPassConfig
) -> Walk:
    """Let the policy walk on the estimated state; it meets the box if the motion is a push.

    Args:
        motion: which of VELOCITIES.
        profile: the plant's.
        seed: of what the profile leaves to chance.
        seconds: to walk.
        config: the estimator's.
    """
    task = load_task(TASK)
    plant = Plant(task.scene, _start(motion), "lowpass", profile, seed)
    guard = CommandGuard(SPOT, plant.model, plant.send, TICK)
    policy, nq = load_policy("spot"), plant.model.nq
    estimator = LowPassEstimator(plant.model, config)
    command, memory = np.array(SPOT.default_command), policy.initial_memory()
    command[:3] = VELOCITIES[motion]
    states, estimates, reason = [], [], ""
    try:
        while plant.tick * TICK < seconds:
            estimate = estimator(plant.read())
            states.append(plant.truth)
            estimates.append(estimate)
            targets, memory = policy.step(estimate[:nq], estimate[nq:], command, memory)
            guard.send(targets)
            plant.advance()
            if plant.truth[2] < SPOT.fall_height:
                raise SumoError("fell")
    except SumoError as error:
        reason = str(error)
    return Walk(plant.model, np.array(states), np.array(estimates), estimator.outliers, reason)


def _start(motion: str) -> np.ndarray:
    task = load_task(TASK)
    state = draw_start(task, 0)
    index = StateIndex(Plant(task.scene, state).model)
    state[index.pose("body")][:2], state[index.pose("body")][3:] = 0.0, (1.0, 0.0, 0.0, 0.0)
    state[index.pose("box")][:2] = BOX_AHEAD[motion], 0.0
    return state


def errors_of(index: StateIndex, states: np.ndarray, estimates: np.ndarray) -> Errors:
    """Compare estimates (T, nq + nv) with the states they are of."""
    positions, velocities = index.joints(SPOT.joints)
    off = estimates - states
    joints = _rms(off[:, positions]) * 1e3, _rms(off[:, velocities])
    base, box = (_body_errors(index, body, states, estimates) for body in ("body", "box"))
    return Errors._make([*base, *joints, *box])


def mean_errors(errors: Sequence[Errors]) -> Errors:
    """Root mean square over walks; nan if there are none."""
    if not errors:
        return Errors._make([np.nan] * len(Errors._fields))
    return Errors._make(np.sqrt(np.square(np.array(errors)).mean(axis=0)).round(4).tolist())


def title(channel: str) -> str:
    """Head a column of errors, with its unit."""
    what, _, unit = channel.partition("_")
    return f"{what} [{unit.replace('_', '/')}]"


def _body_errors(
    index: StateIndex, body: str, states: np.ndarray, estimates: np.ndarray
) -> list[float]:
    """Errors of position [mm], attitude [mrad], velocity [m/s] and rotation [rad/s]."""
    pose, velocity = index.pose(body), index.velocity(body)
    true, seen = states[:, pose], estimates[:, pose]
    turned = to_rotation_vector(multiply(conjugate(true[:, 3:]), seen[:, 3:]))
    linear, angular = np.split(estimates[:, velocity] - states[:, velocity], 2, axis=1)
    return [_rms(seen[:, :3] - true[:, :3]) * 1e3, _rms(turned) * 1e3, _rms(linear), _rms(angular)]


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=-1))))
