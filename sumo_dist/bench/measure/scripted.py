"""Workers that roll nothing out: they answer each request after the time that a rollout would take.

Many of them fit on one core, so the bus, the router and the optimizer can be measured with more
workers than there are cores. They run in a process of their own, as in `python -m`, which is told
on its stdin whom to be, and ends with it.
"""

import heapq
import json
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Self

import numpy as np

from sumo_dist.bench.measure.pool_model import RolloutTimes
from sumo_dist.errors import SumoError
from sumo_dist.priority import go_first
from sumo_dist.services.inbox import Inbox
from sumo_dist.startup import WithoutGraphics
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import POOL, WORKER
from sumo_dist.wire.messages import RolloutReply, RolloutRequest

END_S = 5.0  # for a process to end


@dataclass(frozen=True)
class Script:
    """Whom a process plays.

    Attributes:
        endpoint: of the router.
        names: of its workers.
        build: that they say they have.
        terms: of the costs that they answer with.
        times: what a request takes each.
        seed: of the draws.
    """

    endpoint: str
    names: Sequence[str]
    build: str
    terms: int
    times: RolloutTimes
    seed: int = 0


class Process:
    """A process that plays workers. A context manager."""

    def __init__(self, script: Script) -> None:
        """Start it; its workers are there when it has been entered."""
        with WithoutGraphics():
            self._child = subprocess.Popen(
                [sys.executable, "-P", "-m", __spec__.name],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                start_new_session=True,  # Ctrl-C is ours to handle
            )
        self._script = script

    def __enter__(self) -> Self:
        assert self._child.stdin is not None and self._child.stdout is not None
        self._child.stdin.write(json.dumps(asdict(self._script)) + "\n")
        self._child.stdin.flush()
        if not self._child.stdout.readline():
            raise SumoError("the process of the scripted workers ended; see its messages above")
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._child.communicate(timeout=END_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.communicate()


class Stage:
    """The workers of a process: each takes one request after the other, as a real one would."""

    def __init__(self, script: Script, bus: Bus) -> None:
        """Join the bus."""
        self._script, self._bus = script, bus
        self._rng = np.random.default_rng(script.seed)
        self._changed = threading.Condition()
        self._inboxes = {name: Inbox() for name in script.names}
        self._busy: set[str] = set()
        # when each busy worker is done [time.monotonic()], a number that orders them, and what with
        self._ends: list[tuple[float, int, RolloutReply]] = []
        self._count = 0
        for name in script.names:
            bus.subscribe(RolloutRequest, partial(self._asked, name), address=name)
        for name in script.names:
            bus.announce(WORKER, name, script.build)

    def _asked(self, name: str, request: RolloutRequest) -> None:
        self._inboxes[name].put(request)
        with self._changed:
            if name not in self._busy:
                self._begin(name)

    def _begin(self, name: str) -> None:
        """Begin with a worker's next request, if there is one; the caller has the lock."""
        request = self._inboxes[name].get(timeout=0.0)
        if request is None:
            self._busy.discard(name)
            return
        self._busy.add(name)
        rows = np.array([len(request.knots)])
        takes = float(self._script.times.draw(rows, 1, self._rng)[0, 0])
        self._count += 1
        end = time.monotonic() + takes * 1e-3
        terms = np.zeros((len(request.knots), self._script.terms))
        reply = request.reply(terms, np.ones(len(terms), bool), takes)
        heapq.heappush(self._ends, (end, self._count, reply))
        self._changed.notify()

    def play(self) -> None:
        """Answer when it is time to, until the bus is closed."""
        while True:
            with self._changed:
                while not self._ends or self._ends[0][0] > time.monotonic():
                    wait = self._ends[0][0] - time.monotonic() if self._ends else None
                    self._changed.wait(wait)
                reply = heapq.heappop(self._ends)[2]
                self._begin(reply.worker)
            try:
                self._bus.publish(reply)
            except SumoError:
                return


def main() -> None:
    """Play what stdin's first line says until it is closed."""
    told = json.loads(sys.stdin.readline())
    script = Script(**{**told, "times": RolloutTimes(**told["times"])})
    go_first()
    with Bus.dial(script.endpoint, POOL) as bus:
        stage = Stage(script, bus)
        threading.Thread(target=stage.play, daemon=True).start()
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        sys.stdin.read()


if __name__ == "__main__":
    main()
