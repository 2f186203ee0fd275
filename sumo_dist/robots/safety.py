"""What keeps a robot safe, whoever commands it: limits of its commands and of its state."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Safety:
    """One robot's limits, and how it stops. Tuples are per joint, in the robot's joint order.

    The defaults suit a robot of which nothing is known but its model: targets within the range of
    its servos, at any rate.

    Attributes:
        target_lower, target_upper: of joint targets [rad]; empty takes the servos' ranges.
        target_rate: most a joint target may change [rad/s]; empty does not limit it.
        joint_speed: a joint faster than this stops the robot [rad/s].
        fall_tilt: of the base's vertical axis [rad]; leaning further, it is falling.
        fall_s: for how long it may lean that far before it is stopped [s].
        blind_s: age of the newest state on which it still walks [s].
        stop_s: from the last joint targets to the sitting pose [s], for all joints or one a joint.
        rest_s: for how long that pose is held until the robot is at rest [s].
        rise_s: from the sitting pose back to the stance, when it is told to go on [s].
        rise_tilt: lying further from level than this it does not get up [rad]; 0 if it cannot.
    """

    target_lower: tuple[float, ...] = ()
    target_upper: tuple[float, ...] = ()
    target_rate: tuple[float, ...] = ()
    joint_speed: float = np.inf
    fall_tilt: float = np.pi / 3
    fall_s: float = 0.5
    blind_s: float = 0.1
    stop_s: float | tuple[float, ...] = 0.7
    rest_s: float = 0.7
    rise_s: float = 1.0
    rise_tilt: float = np.radians(20)


def tilt(state: np.ndarray) -> float:
    """Angle between the base's vertical axis and the world's [rad], of a state (nq + nv,).

    The robot comes first in a state: base position, then its quaternion wxyz.
    """
    quat = state[3:7] / np.linalg.norm(state[3:7])
    return float(np.arccos(np.clip(1.0 - 2.0 * (quat[1] ** 2 + quat[2] ** 2), -1.0, 1.0)))
