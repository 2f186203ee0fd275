"""What a worker tells its user: whom it serves, or why nobody. A line a change, not a question."""

import logging
import time
from collections.abc import Set

from sumo_dist.wire.finding import Place, Search
from sumo_dist.wire.keys import Member
from sumo_dist.wire.messages import RolloutReply, RolloutRequest

PATIENCE_S = 5.0  # without a question, before the worker says why that may be

log = logging.getLogger("sumo_dist.worker")


class Serving:
    """Speaks for a worker at one robot's bus."""

    def __init__(self, place: Place, threads: int, aloud: bool) -> None:
        """Speak of a place; of what goes well only aloud."""
        self._place, self._aloud = place, aloud
        self._where = f"{place.robot} at {place.endpoint}"
        self._threads = f"{threads} thread{'s' if threads > 1 else ''}"
        self._said = ""
        self._asked = time.monotonic()

    def answered(self, request: RolloutRequest, reply: RolloutReply) -> None:
        """Take note of an answer."""
        self._asked = time.monotonic()
        if reply.refusal:
            self._say(logging.ERROR, f"not serving {self._where}: {reply.refusal}")
        else:
            self._say(logging.INFO, f"serving {self._where}: {request.task}, {self._threads}")

    def idle(self, optimizers: Set[Member]) -> None:
        """Take note that nothing is asked while these optimizers are there."""
        if optimizers or time.monotonic() < self._asked + PATIENCE_S:
            return
        self._asked = time.monotonic()  # look again after as long
        others = Search(self._place.endpoint).look().places
        names = [other.robot for other in others if other.robot != self._place.robot]
        there = ", ".join(f"--robot {name}" for name in names)
        hint = f"; there is work with {there}" if there else ""
        self._say(logging.WARNING, f"nobody plans for {self._where}{hint}")

    def _say(self, level: int, text: str) -> None:
        if text == self._said:
            return
        self._said = text
        if self._aloud or level > logging.INFO:
            log.log(level, text)
