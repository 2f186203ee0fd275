"""State estimation: from a tick's readings to the state that policy and planner act on."""

from collections.abc import Callable

import mujoco
import numpy as np

from sumo_dist.errors import unknown
from sumo_dist.estimate.lowpass import LowPassConfig, LowPassEstimator
from sumo_dist.estimate.readings import Readings
from sumo_dist.estimate.truth import TruthEstimator

__all__ = ["ESTIMATORS", "LowPassConfig", "LowPassEstimator", "TruthEstimator", "make_estimator"]

ESTIMATORS: dict[str, Callable[[mujoco.MjModel], Callable[[Readings], np.ndarray]]] = {
    "truth": TruthEstimator,
    "lowpass": LowPassEstimator,
}


def make_estimator(mode: str, model: mujoco.MjModel) -> Callable[[Readings], np.ndarray]:
    """Return a new estimator: called once a tick, in order, it gives the state (nq + nv,).

    Args:
        mode: "truth" passes the plant's own state through; "lowpass" fuses sensor packets.
        model: the scene's; only its layout matters.

    Raises:
        UsageError: there is no such mode, or the scene has a joint that it cannot see.
    """
    if mode not in ESTIMATORS:
        raise unknown("estimator", mode, ESTIMATORS)
    return ESTIMATORS[mode](model)
