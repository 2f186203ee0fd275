"""Walks of Spot on its estimated state, with what was true, to hold estimates against."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sumo_dist.bench.measure.channels import Errors, errors_of
from sumo_dist.episode.assemble import draw_start, make_guard
from sumo_dist.errors import SumoError
from sumo_dist.estimate import LowPassConfig, LowPassEstimator
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
    guard, policy, nq = make_guard(task, plant), load_policy("spot"), plant.model.nq
    estimator = LowPassEstimator(plant.model, config)
    command, memory = np.array(SPOT.default_command), policy.initial_memory()
    command[:3] = VELOCITIES[motion]
    states, estimates, reason = [], [], ""
    try:
        while plant.tick * TICK < seconds:
            estimate = estimator(plant.read())
            states.append(plant.state)
            estimates.append(estimate)
            targets, memory = policy.step(estimate[:nq], estimate[nq:], command, memory)
            guard.send(targets)
            if plant.state[2] < SPOT.fall_height:
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
