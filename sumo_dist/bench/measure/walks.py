"""Walks of Spot with what its sensors read and what was true, to hold estimates against."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from sumo_dist.bench.measure.channels import Errors, errors_of
from sumo_dist.episode.assemble import draw_start, make_guard
from sumo_dist.errors import SumoError
from sumo_dist.estimate import LowPassConfig, LowPassEstimator
from sumo_dist.estimate.readings import Readings
from sumo_dist.math.rotations import conjugate, multiply, to_rotation_vector
from sumo_dist.model.index import StateIndex
from sumo_dist.plant.noise import PlantProfile
from sumo_dist.plant.simulated import Plant
from sumo_dist.policies import load_policy
from sumo_dist.robots.spot import SPOT
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK

TASK = "spot/move_box"
SETTLE_S = 1.0  # not counted: the filters start at rest
VELOCITIES = {"push": (0.5, 0.0, 0.0), "turn": (0.3, 0.0, 0.5)}  # vx, vy [m/s], wz [rad/s]
BOX_AHEAD = {"push": 1.1, "turn": 10.0}  # distance of the box from the robot [m]


@dataclass(frozen=True)
class Walk:
    """One walk, tick by tick.

    Attributes:
        model: the plant's.
        readings: T of them.
        states: (T, nq + nv) what was true at the instants of the readings.
        estimates: (T, nq + nv) what the policy acted on.
        outliers: poses that the estimator left out.
        reason: "" if it walked to the end, else why not.
    """

    model: mujoco.MjModel
    readings: list[Readings]
    states: np.ndarray
    estimates: np.ndarray
    outliers: int
    reason: str

    def replay(self, estimate: Callable[[Readings], np.ndarray]) -> np.ndarray:
        """(T, nq + nv) What another estimator makes of the readings; nan where it is blind."""
        seen = np.full_like(self.states, np.nan)
        for row, readings in zip(seen, self.readings, strict=True):
            try:
                row[:] = estimate(readings)
            except SumoError:
                continue
        return seen

    def errors(self, estimates: np.ndarray) -> Errors | None:
        """Compare estimates (T, nq + nv) with the truth; None if the walk ended too early."""
        first = round(SETTLE_S / TICK)
        known = np.isfinite(estimates[first:]).all(axis=1)
        if not known.any():
            return None
        counted = self.states[first:][known], estimates[first:][known]
        return errors_of(StateIndex(self.model), *counted)


def walk(
    motion: str, profile: PlantProfile, seed: int, seconds: float, config: LowPassConfig | None
) -> Walk:
    """Let the policy walk on the estimated state; it meets the box if the motion is a push.

    Args:
        motion: which of VELOCITIES.
        profile: the plant's.
        seed: of what the profile leaves to chance.
        seconds: to walk.
        config: the estimator's; with None the policy walks on the true state.
    """
    task = load_task(TASK)
    plant = Plant(task.scene, _start(motion), "lowpass", profile, seed)
    guard, policy, nq = make_guard(task, plant), load_policy("spot"), plant.model.nq
    estimate = LowPassEstimator(plant.model, config) if config else None
    command, memory = np.array(SPOT.default_command), policy.initial_memory()
    command[:3] = VELOCITIES[motion]
    read, states, estimates, reason = [], [], [], ""
    try:
        while plant.tick * TICK < seconds:
            readings = plant.read()
            seen = estimate(readings) if estimate else plant.state
            read.append(readings)
            states.append(plant.state)
            estimates.append(seen)
            targets, memory = policy.step(seen[:nq], seen[nq:], command, memory)
            guard.send(targets)
            if plant.state[2] < SPOT.fall_height:
                raise SumoError("fell")
    except SumoError as error:
        reason = str(error)
    outliers = estimate.outliers if estimate else 0
    return Walk(plant.model, read, np.array(states), np.array(estimates), outliers, reason)


class Newest:
    """What an estimate would be without a filter: the newest packets, held until the next come.

    Velocities of bodies are differences of the last two frames.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Read packets of a scene with Spot."""
        index = StateIndex(model)
        self._joints = np.concatenate(index.joints(SPOT.joints))
        bodies = index.free_bodies
        self._poses = np.array([np.r_[index.pose(body)] for body in bodies])
        self._velocities = np.array([np.r_[index.velocity(body)] for body in bodies])
        self._state = np.zeros(model.nq + model.nv)
        self._frames: deque[tuple[int, np.ndarray]] = deque(maxlen=2)  # stamps [ms] and poses

    def __call__(self, readings: Readings) -> np.ndarray:
        """Return the state (nq + nv,) that the packets until now show; the first must be there."""
        self._frames.extend(zip(readings.mocap_ms.tolist(), readings.mocap, strict=True))
        (before, old), (stamp, new) = self._frames[0], self._frames[-1]
        turned = to_rotation_vector(multiply(conjugate(old[:, 3:]), new[:, 3:]))
        moved = np.concatenate([new[:, :3] - old[:, :3], turned], axis=1)
        self._state[self._joints] = readings.encoders[-1]
        self._state[self._poses] = new
        self._state[self._velocities] = moved / max(stamp - before, 1) * 1000
        return self._state.copy()


def _start(motion: str) -> np.ndarray:
    task = load_task(TASK)
    state = draw_start(task, 0)
    index = StateIndex(Plant(task.scene, state).model)
    state[index.pose("body")][:2], state[index.pose("body")][3:] = 0.0, (1.0, 0.0, 0.0, 0.0)
    state[index.pose("box")][:2] = BOX_AHEAD[motion], 0.0
    return state
