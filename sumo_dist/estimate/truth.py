"""The plant's own state, as in the paper's analysis."""

import mujoco
import numpy as np

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.estimate.readings import Readings


class TruthEstimator:
    """Passes the true state through. It has no memory."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Expect states of a model."""
        self._size = model.nq + model.nv

    def __call__(self, readings: Readings) -> np.ndarray:
        """Return the state (nq + nv,) at the readings' tick.

        Raises:
            UsageError: the robot has no such oracle.
            SumoError: the state is of another scene.
        """
        if readings.truth.size == 0:
            raise UsageError(
                "estimator 'truth': the robot sends sensor packets and not its true state; "
                "valid for this robot: lowpass"
            )
        if readings.truth.shape != (self._size,):
            raise SumoError(
                f"estimator 'truth': a state of shape {readings.truth.shape}; "
                f"this scene's have ({self._size},)"
            )
        return readings.truth
