"""A body whose motion is given: a recording played back, or a test's own story."""

from collections.abc import Sequence

import numpy as np

from sumo_dist.estimate.readings import Readings


class ScriptedBody:
    """Reports one given state a tick, whatever it is told, and keeps what it was told.

    Attributes:
        tick: policy ticks that have passed.
        sent: joint targets (nu,) in the order they came [rad].
        can_hold: always.
    """

    can_hold = True

    def __init__(self, states: Sequence[np.ndarray], knows_truth: bool = True) -> None:
        """Play states (nq + nv,), the last one for ever; without truth only readings have them."""
        self._states, self._knows_truth = states, knows_truth
        self.tick = 0
        self.sent: list[np.ndarray] = []

    @property
    def truth(self) -> np.ndarray | None:
        """The state of this tick, if the body knows it."""
        return self._state if self._knows_truth else None

    def read(self) -> Readings:
        """Return the state of this tick as the reading of a perfect sensor."""
        none = np.empty(0, np.int64)
        return Readings(self.tick, self._state, none, np.empty((0, 0)), none, np.empty((0, 0, 7)))

    def send(self, targets: np.ndarray) -> None:
        """Keep joint targets."""
        self.sent.append(targets.copy())

    def advance(self) -> None:
        """Go on to the next state."""
        self.tick += 1

    @property
    def _state(self) -> np.ndarray:
        return self._states[min(self.tick, len(self._states) - 1)]
