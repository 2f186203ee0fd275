"""An operator's side of the bus: commands out, and what came of each of them back."""

import itertools
import re
import secrets
import threading
import time

from sumo_dist.episode.command import Verb
from sumo_dist.errors import unknown
from sumo_dist.provenance import user_name
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import WORKER
from sumo_dist.wire.notices import Ack, CommandMessage, Drain

AGAIN_S = 0.1  # a command that is not answered is sent again; the robot carries it out once
PATIENCE_S = 5.0


class Commander:
    """Gives commands to the robot of a bus, from any thread.

    Attributes:
        sender: its name in recordings and traces: the user's, and what no other one has.
    """

    def __init__(self, bus: Bus) -> None:
        """Subscribe to the answers."""
        user = re.sub(r"[^A-Za-z0-9-]", "-", user_name()).strip("-")[:40] or "somebody"
        self.sender = f"{user}-{secrets.token_hex(3)}"
        self._bus = bus
        self._numbers = itertools.count()
        self._changed = threading.Condition()
        self._answers: dict[int, Ack | None] = {}  # of the commands that wait for one
        self._workers = bus.watch(WORKER)
        bus.subscribe(Ack, self._take, address=self.sender)

    def give(self, verb: Verb, name: str = "", value: str = "") -> Ack | None:
        """Send a command until it is answered; return what came of it, None if nothing did."""
        with self._changed:
            number = next(self._numbers)
            self._answers[number] = None
        message = CommandMessage("any", number, self.sender, verb, name, value)
        try:
            return self._ask(message)
        finally:
            with self._changed:
                del self._answers[number]

    def drain(self, worker: str) -> bool:
        """Tell a worker to finish what it was asked and to end; return whether it has.

        Raises:
            UsageError: there is no such worker.
        """
        deadline = time.monotonic() + PATIENCE_S
        time.sleep(AGAIN_S)  # until those that are there are known
        if worker not in (there := self._there()):
            raise unknown("worker", worker, there)
        while worker in self._there():
            if time.monotonic() > deadline:
                return False
            self._bus.publish(Drain("", worker, self.sender))
            time.sleep(AGAIN_S)
        return True

    def _there(self) -> list[str]:
        return sorted(member.id for member in self._workers.now)

    def _ask(self, message: CommandMessage) -> Ack | None:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            self._bus.publish(message)
            with self._changed:
                self._changed.wait_for(lambda: self._answers[message.number], AGAIN_S)
                if (ack := self._answers[message.number]) is not None:
                    return ack
        return None

    def _take(self, ack: Ack) -> None:
        with self._changed:
            if ack.number in self._answers:
                self._answers[ack.number] = ack
                self._changed.notify_all()
