"""Trial workers on other hosts, as a campaign sees them."""

import json
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from queue import Empty
from typing import Any

from sumo_dist.bench.campaign.job import Job
from sumo_dist.bench.campaign.processes import Again
from sumo_dist.dispatch.evaluator import misfit
from sumo_dist.launch.launcher import dialled, listening
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import TrialReply, TrialRequest
from sumo_dist.wire.session import open_router

BENCH = "bench"  # in the place of a robot's name in keys
ROLE = "trial-worker"
RESEND_S = 1.0  # until a request that is not answered is sent again

Row = dict[str, Any]
Tell = Callable[[str], None]


@contextmanager
def remote_pool(listen: str, build: str, tell: Tell) -> Iterator["RemotePool"]:
    """Open a port for trial workers and yield the pool of those that come.

    Args:
        listen: endpoint, such as tcp/0.0.0.0:7447.
        build: engine build that workers must have.
        tell: takes notices.
    """
    endpoint = listening(listen)
    with open_router(endpoint), Bus.dial(dialled(endpoint), BENCH, run=uuid.uuid4().hex) as bus:
        tell(f"waiting for `sumo-dist trial-worker --connect` at {endpoint}")
        yield RemotePool(bus, build, tell)


@dataclass
class _Asked:
    """A request that has not been answered yet."""

    job: Job
    request: TrialRequest
    theirs: Connection
    sent: float = 0.0


class RemotePool:
    """Gives one trial at a time to every worker; one that leaves or refuses loses it to others."""

    def __init__(self, bus: Bus, build: str, tell: Tell) -> None:
        """Watch for workers on a bus of one run; see `remote_pool`."""
        self._bus = bus
        self._build = build
        self._tell = tell
        self._replies = bus.inbox(TrialReply)
        self._members = bus.watch(ROLE)
        self._asked: dict[str, _Asked] = {}  # by worker
        self._of: dict[Connection, str] = {}
        self._refused: set[str] = set()
        self._number = 0

    @property
    def free(self) -> int:
        """How many more trials it would take now."""
        return len(self._idle())

    def start(self, job: Job) -> Connection:
        """Ask an idle worker for a trial."""
        worker = self._idle()[0]
        episode = {k: v for k, v in asdict(job.episode).items() if v is not None}
        planner = episode.pop("planner")
        request = TrialRequest(
            self._bus.run or "", worker, self._number, job.trial.variant, episode, planner
        )
        self._number += 1
        ours, theirs = Pipe(duplex=False)
        self._asked[worker], self._of[ours] = _Asked(job, request, theirs), worker
        self._send(self._asked[worker])
        return ours

    def result(self, ours: Connection) -> Row:
        """Return a trial's row; Again if the worker has left or refused."""
        self._of.pop(ours)
        with ours:
            row = ours.recv()
        if row is None:
            raise Again
        return row

    def tend(self) -> None:
        """Take in replies, give up on workers that left, ask again where no answer came."""
        while True:
            try:
                self._take(self._replies.get_nowait())
            except Empty:
                break
        alive = {member.id for member in self._members.now}
        for worker, asked in list(self._asked.items()):
            if worker not in alive:
                self._tell(f"worker {worker} has left; its trial goes to another")
                self._settle(worker, None)
            elif time.monotonic() - asked.sent > RESEND_S:
                self._send(asked)

    def _idle(self) -> list[str]:
        for member in self._members.now:
            if member.id not in self._refused and (reason := misfit(member, self._build)):
                self._refuse(member.id, reason)
        alive = {member.id for member in self._members.now}
        return sorted(alive - self._refused - self._asked.keys())

    def _send(self, asked: _Asked) -> None:
        asked.sent = time.monotonic()
        self._bus.publish(asked.request)

    def _take(self, reply: TrialReply) -> None:
        asked = self._asked.get(reply.worker)
        if asked is None or asked.request.number != reply.number:
            return  # an answer that came twice
        row, reason = _checked(asked.job, reply)
        if reason:
            self._refuse(reply.worker, reason)
        self._settle(reply.worker, row)

    def _settle(self, worker: str, row: Row | None) -> None:
        with self._asked.pop(worker).theirs as theirs:
            theirs.send(row)

    def _refuse(self, worker: str, reason: str) -> None:
        self._refused.add(worker)
        self._tell(f"worker {worker} gets no trials: {reason}")


def _checked(job: Job, reply: TrialReply) -> tuple[Row | None, str]:
    """Return a reply's row, or None and why it does not count."""
    if reply.refusal:
        return None, reply.refusal
    try:
        row = json.loads(reply.row)
        wanted = {key: value for key, value in job.settings.items() if key != "provenance"}
        differ = [key for key, value in wanted.items() if row[key] != value]
    except (ValueError, TypeError, KeyError) as error:
        return None, f"its answer is not a row of a journal ({error!r})"
    if differ:
        return None, f"its trials differ in {', '.join(differ)}: install the same code there"
    return row, ""
