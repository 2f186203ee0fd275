"""Telling people that plans are slow because other programs have the machine's cores."""

import time
from collections.abc import Callable

from sumo_dist.load import OtherLoad
from sumo_dist.provenance import cores
from sumo_dist.wire.events import Tell

PERIOD_S = 5.0  # between two looks
SLOW = 3.0  # times the measured time of a rollout; contacts alone make less of it
SHARE = 0.25  # of the cores, that others have when it is they who make the rollouts slow
FULL = 0.6  # of the cores: so much is told however long rollouts take
CALM_S = 30.0  # between two lines


class BusyWatch:
    """Looks now and then at how much of this machine is left for rollouts.

    Attributes:
        busy: people were told that it is busy, and not yet that it is not.
    """

    def __init__(self, tell: Tell, others: Callable[[], float | None] | None = None) -> None:
        """Start with a machine that is not busy.

        Args:
            tell: speaks to people.
            others: cores that other programs have used since the call before; None if unknown.
        """
        self._tell, self._others = tell, others or OtherLoad().used
        self._looked, self._told = time.monotonic(), -CALM_S
        self.busy = False

    def look(self, slowdown: float) -> None:
        """Look, if it is time to, and tell what has changed.

        Args:
            slowdown: how many times as long as measured the rollouts take.
        """
        now = time.monotonic()
        if now < self._looked + PERIOD_S:
            return
        self._looked, used, there = now, self._others(), cores()
        if used is None or now < self._told + CALM_S:
            return
        share = used / there
        threshold = 0.5 if self.busy else 1.0  # what was told is not taken back for a trifle
        slow = slowdown >= SLOW * threshold and share >= SHARE * threshold
        busy = slow or share >= FULL * threshold
        if busy == self.busy:
            return
        self.busy, self._told = busy, now
        if busy:
            takes = f"plans take {slowdown:.0f}x their measured time" if slow else ""
            use = f"other programs use {used:.1f} of {there} cores"
            said = f"{takes} ({use})" if slow else use
            self._tell(
                "warning",
                f"this machine is busy: {said}; workers give way to them unless the run has "
                "--no-give-way",
            )
        else:
            self._tell("info", "this machine is not busy any more")
