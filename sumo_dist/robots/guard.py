"""The last thing that every command passes on its way to a robot."""

from collections import Counter
from collections.abc import Callable

import mujoco
import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.robots.robot import Robot

NON_FINITE, POSITION, RATE = "non-finite", "position", "rate"


class CommandGuard:
    """Sends joint targets within a robot's limits, and counts what it had to change.

    A target that is within them is sent as it came, bit for bit.

    Attributes:
        sent: commands so far.
        changed: commands that were not sent as they came, by reason: "non-finite" (the target
            before it is held), "position" and "rate" (cut to the limit).
    """

    def __init__(
        self,
        robot: Robot,
        model: mujoco.MjModel,
        send: Callable[[np.ndarray], None],
        period: float,
    ) -> None:
        """Guard the way to a robot.

        Args:
            robot: whose limits hold.
            model: compiled with it; its servos' ranges stand in for limits it does not state.
            send: takes joint targets (nu,) [rad] that are within the limits.
            period: from a command to the next [s].

        Raises:
            UsageError: the robot states limits for another number of joints than it has.
        """
        safety, count = robot.safety, len(robot.joints)
        limited = model.actuator_ctrllimited[:count].astype(bool)
        ranges = np.where(limited[:, None], model.actuator_ctrlrange[:count], [-np.inf, np.inf])
        self._lower = _each("target_lower", safety.target_lower, count, ranges[:, 0])
        self._upper = _each("target_upper", safety.target_upper, count, ranges[:, 1])
        rate = _each("target_rate", safety.target_rate, count, np.full(count, np.inf))
        self._step = rate * period  # [rad] between commands
        self._send = send
        self.last = np.clip(np.array(robot.stand), self._lower, self._upper)
        self.sent = 0
        self.changed: Counter[str] = Counter()

    def send(self, targets: np.ndarray) -> bool:
        """Send what is safe of joint targets (nu,) [rad]; return whether all were finite."""
        finite = np.isfinite(targets)
        safe = np.where(finite, targets, self.last)
        reachable = np.clip(safe, self._lower, self._upper)
        paced = np.clip(reachable, self.last - self._step, self.last + self._step)
        self.changed[NON_FINITE] += int(not finite.all())
        self.changed[POSITION] += int((reachable != safe).any())
        self.changed[RATE] += int((paced != reachable).any())
        self.sent += 1
        self.last = paced
        self._send(paced)
        return bool(finite.all())

    def account(self) -> dict[str, int]:
        """Commands sent, and how many of them were changed, by reason."""
        reasons = (NON_FINITE, POSITION, RATE)
        return {"sent": self.sent, **{reason: self.changed[reason] for reason in reasons}}


def _each(name: str, limits: tuple[float, ...], count: int, otherwise: np.ndarray) -> np.ndarray:
    if limits and len(limits) != count:
        raise UsageError(f"robot's safety: {name} has {len(limits)} numbers for {count} joints")
    return np.array(limits) if limits else otherwise
