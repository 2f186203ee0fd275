"""Which workers there are, how fast each is, and which of them are asked."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from sumo_dist.dispatch.busy import BusyWatch
from sumo_dist.dispatch.pace import Pace, Turnaround
from sumo_dist.dispatch.silences import Silences
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.events import Tell
from sumo_dist.wire.keys import SCHEMA, Member
from sumo_dist.wire.messages import RolloutReply
from sumo_dist.wire.notices import POOL_HEALTH, WorkerHealth, WorkerStatus

MISSES_TO_SUSPEND = 2  # plans in a row without any answer before a worker is passed over
REFUSALS_TO_LEAVE_OUT = 2  # in a row: one may have been spoilt on its way
PROBE_S = 1.0  # how often a worker that gets no rows is tried
SPEED_MEMORY = 0.8  # weight of the past in a worker's measured speed
TIMELY_MEMORY = 0.9  # likewise in the share of its rows that come in time
GUESS = 0.1  # rows per ms of a worker while none has answered
FIRST = 32  # workers that are asked at a time while none has answered
MEASURED_ANSWERS = 20  # after so many a worker's speed counts as measured
LEAST_TIMELY = 0.05  # of a worker that is never in time, so that it is still asked for something


def misfit(member: Member, build: str) -> str:
    """Say why a service cannot work with this one; "" if it can."""
    if member.schema != SCHEMA:
        return f"its messages have version {member.schema}, here it is {SCHEMA}"
    if member.build != build:
        return (
            f"its build is {member.build}, here it is {build}: install the same version on both "
            "hosts; if only the instruction sets differ, give all of them --engine native-portable"
        )
    return ""


@dataclass
class Worker:
    """One worker as its answers have shown it.

    Attributes:
        member: its token.
        refusal: why it is left out; "" if it is not.
        speed: rows per ms that it rolls out; 0 before its first answer.
        misses: plans in a row without any answer.
        refusals: in a row.
        leaving: it has said that it is about to.
        threads: that it rolls out with.
        turnaround: how long its answers take.
        asked, heard: time.monotonic() of the last request and answer, 0 before the first.
        lost: rows it was asked for and did not answer in time.
        timely: share of its rows that come in time.
        answers: so far, to questions of the same kind.
        measured: its highest speed at them, as an average of many answers.
        blames: what of the task's own code raises there; "" if nothing does.
    """

    member: Member
    refusal: str
    speed: float = 0.0
    misses: int = 0
    refusals: int = 0
    leaving: bool = False
    threads: int = 1
    turnaround: Turnaround = field(default_factory=Turnaround)
    asked: float = 0.0
    heard: float = 0.0
    lost: int = 0
    timely: float = 1.0
    answers: int = 0
    measured: float = 0.0
    blames: str = ""

    def pace(self, guess: float) -> Pace:
        """What can be counted on: other work on its cores makes some of its rows late.

        Args:
            guess: its speed before its first answer, rows per ms.
        """
        rows_per_ms = (self.speed or guess) * max(LEAST_TIMELY, self.timely)
        return Pace(rows_per_ms, self.turnaround.wait_ms, self.threads)

    @property
    def willing(self) -> bool:
        """Whether it may be asked at all."""
        return not self.refusal and not self.leaving

    @property
    def steady(self) -> bool:
        """Whether rows that a plan needs may be entrusted to it."""
        return self.heard > 0 and self.misses < MISSES_TO_SUSPEND

    def answered(self, reply: RolloutReply, at: float) -> None:
        """Learn its speed and wait from an answer that came at time.monotonic() `at`.

        From late answers too: those in time alone would flatter it.
        """
        speed = len(reply.valid) / max(reply.compute_ms, 1e-3)
        past = SPEED_MEMORY if self.answers else 0.0  # at other questions it was another
        self.speed = past * self.speed + (1.0 - past) * speed
        self.turnaround.answered(reply.shard, reply.compute_ms, at)
        self.threads = reply.threads
        self.answers += 1
        if self.answers >= MEASURED_ANSWERS:
            self.measured = max(self.measured, self.speed)

    def measure_again(self) -> None:
        """Forget how fast it was: the questions are of another kind now."""
        self.answers, self.measured = 0, 0.0
        self.turnaround.restart()

    def took(self, share: float) -> None:
        """Learn which share of a plan's rows came in time."""
        self.timely = TIMELY_MEMORY * self.timely + (1.0 - TIMELY_MEMORY) * share


class Workers:
    """The workers that an optimizer knows."""

    def __init__(self, build: str, tell: Tell) -> None:
        """Expect workers of an engine's build; `tell(level, text)` hears what users should know."""
        self._build, self._tell = build, tell
        self._busy = BusyWatch(tell)
        self._silences = Silences(tell, explained=lambda: self._busy.busy)
        self._workers: dict[str, Worker] = {}

    def __len__(self) -> int:
        """Number of workers that take shards."""
        return len(self.asked())

    def get(self, name: str) -> Worker | None:
        """Return a worker; None if it has left."""
        return self._workers.get(name)

    def asked(self) -> dict[str, Pace]:
        """Paces of the workers that get a plan's rows.

        They are those that answer. While there is none, those are asked that were not asked for
        longest: somebody must be the first. So a token whose owner never answers costs no rows,
        however many there are.
        """
        willing = {name: w for name, w in list(self._workers.items()) if w.willing}
        speeds = [w.speed for w in willing.values() if w.speed]
        guess = sum(speeds) / len(speeds) if speeds else GUESS
        if steady := {name: w.pace(guess) for name, w in willing.items() if w.steady}:
            return steady
        longest_ago = sorted(willing, key=lambda name: willing[name].asked)
        return {name: willing[name].pace(guess) for name in longest_ago[:FIRST]}

    def to_try(self, began: float) -> list[str]:
        """Names of workers that are due to be tried with a row that another one has as well.

        Those are who was not asked for a while: it does not answer, never has, or is so slow or far
        away that it gets no rows. They are one at a time of those that answer and one of the
        others; all of them while nobody has answered: who does is found at once.

        Args:
            began: time.monotonic() before the first was asked for this plan.
        """
        due = min(began, time.monotonic() - PROBE_S)
        names = [name for name, w in self._workers.items() if w.willing and w.asked < due]
        names.sort(key=lambda name: self._workers[name].asked)
        steady = [name for name in names if self._workers[name].steady]
        others = [name for name in names if not self._workers[name].steady]
        if any(w.steady for w in self._workers.values()):
            return steady[:1] + others[:1]
        return others

    def joined_or_left(self, member: Member, alive: bool) -> bool:
        """Take note of a member; return whether its rows must be given to others."""
        if alive:
            refusal = misfit(member, self._build)
            self._workers[member.id] = Worker(member, refusal)
            if refusal:
                self._tell("error", f"worker {member.id} is left out: {refusal}")
            else:
                self._tell("info", f"worker {member.id} joined")
        elif (known := self._workers.get(member.id)) and known.member == member:
            del self._workers[member.id]
            self._silences.left(member.id)
            self._tell("warning", f"worker {member.id} left")
            return True
        return False

    def heard(self, worker: Worker) -> None:
        """Note an answer."""
        if worker.misses >= MISSES_TO_SUSPEND and worker.heard:
            self._silences.ended(worker.member.id)
        worker.misses, worker.heard = 0, time.monotonic()

    def refused(self, worker: Worker, reason: str) -> None:
        """Note a refusal."""
        worker.refusals += 1
        if worker.refusals >= REFUSALS_TO_LEAVE_OUT and not worker.refusal:
            worker.refusal = reason
            self._tell("error", f"worker {worker.member.id} is left out: {reason}")

    def blamed(self, worker: Worker, reason: str) -> None:
        """Note that the task's own code raises there: it would again, so it is left out at once."""
        known = any(w.blames == reason for w in self._workers.values())
        worker.blames = worker.refusal = reason
        if not known:
            self._tell("error", f"worker {worker.member.id} is left out: {reason}")

    @property
    def verdict(self) -> str:
        """What of the task's own code raises, once no worker is left that says otherwise; "" else.

        So one worker that lies, or lacks a file, costs no more than its own rows.
        """
        workers = self._workers.values()
        if any(not w.refusal and w.misses < MISSES_TO_SUSPEND for w in workers):
            return ""
        return next((w.blames for w in workers if w.blames), "")

    def missed(self, name: str) -> None:
        """Note that a worker has not answered at all."""
        worker = self._workers.get(name)
        if worker is not None:
            worker.misses += 1
            if worker.misses == MISSES_TO_SUSPEND and worker.heard:
                self._silences.began(name)

    @property
    def slowdown(self) -> float:
        """How many times as long as measured the rollouts take; 1 where nothing is measured."""
        known = [w for w in list(self._workers.values()) if w.measured > 0]
        return sum(w.measured for w in known) / sum(w.speed for w in known) if known else 1.0

    def measure_again(self) -> None:
        """Forget how fast they were: the plans are of another kind now."""
        for worker in list(self._workers.values()):
            worker.measure_again()

    def forgive(self) -> None:
        """Ask those again that refused: the task is another one now."""
        for worker in self._workers.values():
            worker.refusal, worker.refusals = misfit(worker.member, self._build), 0
            worker.blames = ""

    def publish_health(self, bus: Bus, source: str) -> None:
        """Tell of all of them, as their optimizer; called on another thread than the rest."""
        self._silences.look()
        self._busy.look(self.slowdown)
        told = list(self._told())
        for first in range(0, len(told), POOL_HEALTH):
            bus.publish(WorkerHealth.of(bus.run or "", source, told[first : first + POOL_HEALTH]))

    def _told(self) -> Iterator[WorkerStatus]:
        now = time.monotonic()
        for name, worker in list(self._workers.items()):
            silent = "has not answered yet" if not worker.heard else "passed over"
            if worker.leaving:
                silent = "is leaving"
            answers = worker.steady and not worker.leaving
            state = worker.refusal or ("answers" if answers else silent)
            since = now - worker.heard if worker.heard else -1.0
            rollouts_per_s = float(np.round(worker.pace(0.0).rows_per_ms * 1e3))
            yield WorkerStatus(name, state, rollouts_per_s, worker.lost, since)
