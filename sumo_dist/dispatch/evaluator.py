"""Rolling out candidates on workers across the bus: shards out, costs back, nobody waited for."""

import queue
import threading
import time
from dataclasses import asdict, dataclass, field

import numpy as np

from sumo_dist.dispatch.sharding import split
from sumo_dist.errors import Interrupted
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.problem import Problem
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.events import Tell
from sumo_dist.wire.keys import SCHEMA, Member
from sumo_dist.wire.messages import RolloutReply, RolloutRequest

RESEND_S = 1.0  # a shard unanswered for this long goes to another worker
CHUNK = 8  # rows a request when there is a deadline, so that a late worker is late with few
MISSES_TO_BENCH = 2  # plans in a row without any answer before a worker is passed over
STRIKES = 2  # refusals in a row after which a worker is left out: one may have been spoilt
PROBE_S = 1.0  # how often a benched worker is asked again
PACE = " rollouts/s"  # ends the name of the counter that says how fast a worker is
SPEED_MEMORY = 0.8  # weight of the past in a worker's measured speed
TIMELY_MEMORY = 0.9  # likewise in the share of its rows that come in time
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


@dataclass(frozen=True)
class Change:
    """A worker joined or left."""

    member: Member
    alive: bool


@dataclass
class _Worker:
    member: Member
    refusal: str
    speed: float = 0.1  # rows per ms
    misses: int = 0
    strikes: int = 0
    asked: float = 0.0  # time.monotonic() of the last request
    heard: float = 0.0  # likewise of the last answer
    lost: int = 0  # rows it was asked for and did not answer in time
    timely: float = 1.0  # share of its rows that come in time

    @property
    def pace(self) -> float:
        """Rows per ms that can be counted on: other work on its cores makes some of them late."""
        return self.speed * max(LEAST_TIMELY, self.timely)


@dataclass
class _Shard:
    worker: str
    start: int
    count: int
    sent: float
    done: bool = False
    lost: bool = False


@dataclass
class _Job:
    """One iteration's candidates and what is known of them."""

    request: PlanRequest
    iteration: int
    knots: np.ndarray
    terms: np.ndarray
    valid: np.ndarray
    answered: np.ndarray
    shards: dict[int, _Shard] = field(default_factory=dict)

    def open_rows(self) -> list[tuple[int, int]]:
        """Runs of rows that are neither answered nor with a worker: (first row, rows)."""
        free = ~self.answered
        for shard in self.shards.values():
            if not shard.done:
                free[shard.start : shard.start + shard.count] = False
        edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
        return [(int(a), int(b - a)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


class RemoteEvaluator:
    """Evaluates candidates on whatever workers are alive. One plan at a time.

    Without a deadline every candidate is sent again until somebody has answered it; with one, what
    is late is left out. A worker that leaves gives up its shards at once.
    """

    def __init__(
        self,
        bus: Bus,
        run: str,
        problem: Problem,
        config: PlannerConfig,
        build: str,
        stop: threading.Event,
        tell: Tell,
    ) -> None:
        """Subscribe to replies and members; `tell(level, text)` hears of what users should know."""
        self._bus, self._run, self._problem, self._build = bus, run, problem, build
        self._settings = asdict(config)
        self._stop, self._tell = stop, tell
        self._inbox: queue.SimpleQueue[RolloutReply | Change] = queue.SimpleQueue()
        self._workers: dict[str, _Worker] = {}
        self._shards_sent = 0
        self.deadline: float | None = None  # time.monotonic() at which evaluation must return
        self.reissued = 0  # rows sent a second time, since the last reset_account()
        self.waited_s = 0.0  # time spent waiting for workers, likewise
        bus.subscribe(RolloutReply, self._inbox.put)
        bus.watch("worker", lambda member, alive: self._inbox.put(Change(member, alive)))

    @property
    def workers(self) -> int:
        """Number of workers that take shards."""
        return len(self._usable())

    @property
    def pace(self) -> float:
        """Rollouts per ms of all workers that take shards, as measured on their answers."""
        return sum(self._usable().values())

    def workers_health(self) -> dict[str, int | float | str]:
        """Of each worker: whether it answers, its pace, when it was heard, and what it has lost."""
        counters: dict[str, int | float | str] = {}
        now = time.monotonic()
        for name, worker in list(self._workers.items()):  # another thread may be at it
            benched = "passed over" if worker.misses >= MISSES_TO_BENCH else ""
            counters[f"{name} state"] = (worker.refusal or benched or "answers")[:200]
            counters[name + PACE] = round(worker.pace * 1e3)
            counters[f"{name} lost"] = worker.lost
            if worker.heard:
                counters[f"{name} silent s"] = round(now - worker.heard, 2)
        return counters

    def reset_account(self, deadline: float | None) -> None:
        """Start the account of a new plan."""
        self.deadline, self.reissued, self.waited_s = deadline, 0, 0.0

    def __call__(self, request: PlanRequest, iteration: int, knots: np.ndarray) -> Evaluation:
        """Evaluate knots (B, K, n); rows nobody answered in time come back unanswered."""
        count, terms = len(knots), len(self._problem.task.cost)
        job = _Job(
            request,
            iteration,
            knots,
            np.full((count, terms), np.nan),
            np.zeros(count, bool),
            np.zeros(count, bool),
        )
        while not self._inbox.empty():  # who came and went since the last plan
            self._take(job, self._inbox.get())
        while not job.answered.all():
            if self._stop.is_set():
                raise Interrupted("told to stop while waiting for rollouts")
            self._assign(job)
            item = self._next(job)
            if item is not None:
                self._take(job, item)
            elif self._late():
                break
            else:
                self._give_up_overdue(job)
        self._close(job)
        return Evaluation(job.terms, job.valid, job.answered, np.empty(0, np.float32))

    def _usable(self) -> dict[str, float]:
        """Paces of the workers to ask: those that answer, and now and then one that did not."""
        willing = {name: w for name, w in self._workers.items() if not w.refusal}
        due = time.monotonic() - PROBE_S
        steady = {n: w for n, w in willing.items() if w.misses < MISSES_TO_BENCH or w.asked < due}
        return {name: worker.pace for name, worker in (steady or willing).items()}

    def _assign(self, job: _Job) -> None:
        """Give every row that is with nobody to the workers, by speed."""
        speeds = self._usable()
        if not speeds:
            return
        for start, count in job.open_rows():
            for worker, first, rows in split(start, count, speeds):
                chunk = rows if self.deadline is None else CHUNK
                for offset in range(0, rows, chunk):
                    self._send(job, worker, first + offset, min(chunk, rows - offset))

    def _send(self, job: _Job, worker: str, start: int, count: int) -> None:
        self._shards_sent += 1
        now = self._workers[worker].asked = time.monotonic()
        job.shards[self._shards_sent] = _Shard(worker, start, count, now)
        budget = 0.0 if self.deadline is None else max(1e-3, self.deadline - now)
        request = job.request
        self._bus.publish(
            RolloutRequest(
                run=self._run,
                worker=worker,
                number=request.number,
                iteration=job.iteration,
                shard=self._shards_sent,
                start=start,
                task=self._problem.task.source,
                task_hash=self._problem.hash,
                build=self._build,
                settings=self._settings,
                state=request.state,
                memory=request.memory,
                knots=job.knots[start : start + count],
                reply_budget_ms=budget * 1e3,
            )
        )

    def _next(self, job: _Job) -> "RolloutReply | Change | None":
        """Wait for the next message, at most until something has to be decided."""
        due = min((s.sent + RESEND_S for s in job.shards.values() if not s.done), default=np.inf)
        until = min(due, self.deadline if self.deadline is not None else np.inf)
        began = time.monotonic()
        try:
            return self._inbox.get(timeout=float(np.clip(until - began, 0.0, 0.1)))
        except queue.Empty:
            return None
        finally:
            self.waited_s += time.monotonic() - began

    def _take(self, job: _Job, item: RolloutReply | Change) -> None:
        if isinstance(item, RolloutReply):
            self._accept(job, item)
        else:
            self._member(job, item)

    def _accept(self, job: _Job, reply: RolloutReply) -> None:
        """Enter a reply; anything that does not fit what was asked is refused, by name."""
        worker = self._workers.get(reply.worker)
        if worker is None:
            return  # the last words of one that has left
        if worker.misses >= MISSES_TO_BENCH:
            self._tell("info", f"worker {reply.worker} answers again")
        worker.misses, worker.heard = 0, time.monotonic()
        if reply.refusal:
            self._refused(job, reply)
            return
        # From late answers too: those in time alone would make a worker look faster than it is.
        speed = len(reply.valid) / max(reply.compute_ms, 1e-3)
        worker.speed = SPEED_MEMORY * worker.speed + (1.0 - SPEED_MEMORY) * speed
        shard = job.shards.get(reply.shard)
        if shard is None or (reply.number, reply.iteration) != (job.request.number, job.iteration):
            return  # late: its plan has gone out
        rows = slice(shard.start, shard.start + shard.count)
        if (reply.start, reply.worker) != (shard.start, shard.worker) or (
            reply.terms.shape != job.terms[rows].shape or reply.valid.shape != (shard.count,)
        ):
            self._refused(job, reply, f"sent costs of shape {reply.terms.shape}")
            return
        shard.done, worker.strikes = True, 0
        job.terms[rows] = np.where(reply.valid[:, None], reply.terms, np.nan)
        job.valid[rows], job.answered[rows] = reply.valid, True

    def _refused(self, job: _Job, reply: RolloutReply, reason: str | None = None) -> None:
        worker = self._workers[reply.worker]
        worker.strikes += 1
        if worker.strikes >= STRIKES and not worker.refusal:
            worker.refusal = reason or reply.refusal
            self._tell("error", f"worker {reply.worker} is left out: {worker.refusal}")
        self._take_back(job, reply.worker)

    def _member(self, job: _Job, change: Change) -> None:
        member = change.member
        if change.alive:
            refusal = misfit(member, self._build)
            self._workers[member.id] = _Worker(member, refusal)
            if refusal:
                self._tell("error", f"worker {member.id} is left out: {refusal}")
            else:
                self._tell("info", f"worker {member.id} joined")
        elif (known := self._workers.get(member.id)) and known.member == member:
            del self._workers[member.id]
            self._tell("warning", f"worker {member.id} left")
            self._take_back(job, member.id)

    def _take_back(self, job: _Job, worker: str) -> None:
        for shard in job.shards.values():
            if shard.worker == worker and not shard.done:
                self._abandon(shard)

    def _abandon(self, shard: _Shard) -> None:
        shard.done = True
        self.reissued += shard.count
        self._lose(shard)

    def _lose(self, shard: _Shard) -> None:
        shard.lost = True
        if worker := self._workers.get(shard.worker):
            worker.lost += shard.count

    def _late(self) -> bool:
        return self.deadline is not None and time.monotonic() >= self.deadline

    def _give_up_overdue(self, job: _Job) -> None:
        for shard in job.shards.values():
            if not shard.done and time.monotonic() - shard.sent >= RESEND_S:
                self._miss(shard.worker)
                self._abandon(shard)

    def _close(self, job: _Job) -> None:
        """Note what was not answered in time, and who did not answer at all."""
        for shard in job.shards.values():
            if not shard.done:
                self._lose(shard)
        for name in {shard.worker for shard in job.shards.values()}:
            given = [shard for shard in job.shards.values() if shard.worker == name]
            if worker := self._workers.get(name):
                share = sum(s.count for s in given if not s.lost) / sum(s.count for s in given)
                worker.timely = TIMELY_MEMORY * worker.timely + (1.0 - TIMELY_MEMORY) * share
            if not any(shard.done for shard in given):
                self._miss(name)

    def _miss(self, name: str) -> None:
        worker = self._workers.get(name)
        if worker is not None:
            worker.misses += 1
            if worker.misses == MISSES_TO_BENCH:
                self._tell("warning", f"worker {name} does not answer: it is passed over")
