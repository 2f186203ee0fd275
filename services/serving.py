"""What a worker tells its user: whom it serves, or why not. A line a change, not a question."""

import logging
import time
from collections.abc import Set

from sumo_dist.wire.keys import Member
from sumo_dist.wire.messages import RolloutReply, RolloutRequest

PATIENCE_S = 5.0  # without an optimizer, before the worker says that nobody needs it

log = logging.getLogger("sumo_dist.worker")


class Serving:
    """Speaks for a worker at a router."""

    def __init__(self, endpoint: str, threads: int, aloud: bool) -> None:
        """Speak of a router's robots; of what goes well only aloud."""
        self._endpoint, self._aloud = endpoint, aloud
        self._threads = f"{threads} thread{'s' if threads > 1 else ''}"
        self._said: dict[str, str] = {}  # by robot, "" of none
        self._asked = time.monotonic()

    def answered(self, request: RolloutRequest, reply: RolloutReply) -> None:
        """Take note of an answer."""
        self._asked = time.monotonic()
        self._said.pop("", None)
        whom = f"{request.robot} at {self._endpoint}"
        if reply.refusal:
            self._say(logging.ERROR, request.robot, f"not serving {whom}: {reply.refusal}")
        else:
            text = f"serving {whom}: {request.task}, {self._threads}"
            self._say(logging.INFO, request.robot, text)

    def idle(self, optimizers: Set[Member]) -> None:
        """Take note that nothing is asked while these optimizers are there."""
        if not optimizers and time.monotonic() > self._asked + PATIENCE_S:
            self._say(logging.WARNING, "", f"nobody plans at {self._endpoint}")

    def _say(self, level: int, robot: str, text: str) -> None:
        if text == self._said.get(robot):
            return
        self._said[robot] = text
        if self._aloud or level > logging.INFO:
            log.log(level, text)
