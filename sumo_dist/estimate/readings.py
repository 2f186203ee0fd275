"""What a robot's sensors deliver, tick by tick."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Readings:
    """What the sensors saw since the tick before, up to the instant of this tick.

    Attributes:
        tick: policy tick.
        truth: (nq + nv,) the plant's state; empty if the robot has no such oracle.
        encoder_ms, encoders: (E,) stamps and (E, 2 nj) joint positions and velocities.
        mocap_ms, mocap: (M,) stamps and (M, bodies, 7) poses: position, quaternion wxyz.
    """

    tick: int
    truth: np.ndarray
    encoder_ms: np.ndarray
    encoders: np.ndarray
    mocap_ms: np.ndarray
    mocap: np.ndarray
