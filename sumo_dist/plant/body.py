"""What a robot's body is to the rest: sensors in, joint targets out, and a clock."""

from typing import Protocol

import numpy as np

from sumo_dist.estimate.readings import Readings


class Body(Protocol):
    """A robot, simulated or real; loops, estimator and guard know nothing else of it."""

    @property
    def tick(self) -> int:
        """Policy ticks of robot time that have passed."""
        ...

    @property
    def truth(self) -> np.ndarray | None:
        """The true state (nq + nv,); None where nobody knows it."""
        ...

    @property
    def can_hold(self) -> bool:
        """Whether time passes only with `advance`, so that the body can be paused."""
        ...

    def read(self) -> Readings:
        """Return what the sensors saw since the tick before, stamped in robot time."""
        ...

    def send(self, targets: np.ndarray) -> None:
        """Hand joint targets (nu,) [rad] to the servos, which hold them until the next come."""
        ...

    def advance(self) -> None:
        """Let the tick pass: a simulated body computes it, a real one has passed it by itself.

        Raises:
            SumoError: the body is in no state to go on.
        """
        ...
