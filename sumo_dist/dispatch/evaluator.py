"""Rolling out candidates on workers across the bus: shards out, costs back, nobody waited for."""

import queue
import secrets
import threading
import time
from collections import Counter
from dataclasses import asdict, dataclass, field

import numpy as np

from sumo_dist.dispatch.pace import Pace
from sumo_dist.dispatch.sharding import chunk, split
from sumo_dist.dispatch.workers import Workers
from sumo_dist.errors import Interrupted, TaskError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.problem import Problem
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.codec import Template
from sumo_dist.wire.events import Tell
from sumo_dist.wire.keys import WORKER, Member
from sumo_dist.wire.messages import RolloutReply, RolloutRequest

RESEND_S = 1.0  # a shard unanswered for this long goes to another worker
REQUESTS = 4  # that a worker gets one after another when there is a deadline
LOOK_S = 0.1  # between two looks for shards that are overdue
OWN = ("worker", "shard", "start", "knots", "reply_budget_ms")  # a request's, not its plan's


@dataclass(frozen=True)
class Change:
    """A worker joined or left."""

    member: Member
    alive: bool


@dataclass(frozen=True)
class Heard:
    """A reply, and time.monotonic() at which it came."""

    reply: RolloutReply
    at: float


@dataclass
class _Shard:
    worker: str
    start: int
    count: int
    sent: float
    spare: bool = False  # its rows are with another worker as well: nobody waits for this one
    done: bool = False
    lost: bool = False


@dataclass
class _Job:
    """One iteration's candidates and what is known of them."""

    number: int  # counts jobs
    request: PlanRequest
    iteration: int
    knots: np.ndarray
    terms: np.ndarray
    valid: np.ndarray
    answered: np.ndarray
    template: Template
    left: int  # rows that are not answered
    open: list[tuple[int, int]]  # (first row, rows) that are with no worker
    shards: dict[int, _Shard] = field(default_factory=dict)

    def enter(self, shard: _Shard, reply: RolloutReply) -> None:
        """Enter the costs of a shard, which another worker may have answered before."""
        rows = slice(shard.start, shard.start + shard.count)
        self.terms[rows] = np.where(reply.valid[:, None], reply.terms, np.nan)
        self.valid[rows] = reply.valid
        self.left -= int(np.count_nonzero(~self.answered[rows]))
        self.answered[rows] = shard.done = True


class RemoteEvaluator:
    """Evaluates candidates on whatever workers are alive. One plan at a time.

    Without a deadline every candidate is sent again until somebody has answered it; with one, what
    is late is left out. A worker that leaves gives up its shards at once.

    Attributes:
        workers: all that are known.
        reissued: rows sent a second time for this plan.
        waited_s: time spent waiting for workers for this plan.
    """

    def __init__(
        self,
        bus: Bus,
        name: str,
        build: str,
        stop: threading.Event,
        tell: Tell,
        priority: int = 0,
    ) -> None:
        """Subscribe to replies and members.

        Args:
            bus: of the robot.
            name: of the optimizer; replies come to it alone.
            build: that workers must have.
            stop: ends the waiting.
            tell: `tell(level, text)` hears what users should know.
            priority: of the robot among those that the workers serve.
        """
        self._bus, self._build, self._stop = bus, build, stop
        # Of this process alone: one that is restarted does not take its predecessor's answers.
        self._asker = f"{name[:50]}-{secrets.token_hex(4)}"
        self._priority = priority
        self._inbox: queue.SimpleQueue[Heard | Change] = queue.SimpleQueue()
        self._shard = self._jobs = 0  # the last one's, and how many there were
        self._problem: Problem | None = None
        self._config: PlannerConfig | None = None
        self._settings: dict[str, int | float | str] = {}
        self._deadline: float | None = None
        self.workers = Workers(build, tell)
        self.reissued = 0
        self.waited_s = 0.0
        bus.subscribe(RolloutReply, self._on_reply, address=self._asker)
        bus.watch(WORKER, lambda member, alive: self._inbox.put(Change(member, alive)))

    def _on_reply(self, reply: RolloutReply) -> None:
        self._inbox.put(Heard(reply, time.monotonic()))

    def begin(
        self, problem: Problem, settings: PlannerConfig, deadline: float | None = None
    ) -> None:
        """Turn to a new plan.

        Args:
            problem: what is rolled out.
            settings: of its planner.
            deadline: time.monotonic() at which evaluation must return; None waits for every row.
        """
        if self._problem is None or problem.hash != self._problem.hash:
            self.workers.forgive()
        if settings != self._config or problem is not self._problem:
            self.workers.measure_again()
            self._config, self._settings = settings, asdict(settings)
        self._problem = problem
        self._deadline, self.reissued, self.waited_s = deadline, 0, 0.0

    def __call__(self, request: PlanRequest, iteration: int, knots: np.ndarray) -> Evaluation:
        """Evaluate knots (B, K, n); rows nobody answered in time come back unanswered.

        Raises:
            TaskError: the task's own code raises on every worker.
            Interrupted: told to stop.
        """
        job = self._job(request, iteration, knots)
        while not self._inbox.empty():  # who came and went since the last plan
            self._take(job, self._inbox.get())
        looked = time.monotonic()
        self._assign(job)
        for name in self.workers.to_try(looked):  # with a row that another one has, too
            self._send(job, name, 0, 1, spare=True)
        while job.left > 0:
            if self._stop.is_set():
                raise Interrupted("told to stop while waiting for rollouts")
            if reason := self.workers.verdict:
                raise TaskError(reason)
            self._assign(job)
            item = self._next()
            if item is not None:
                self._take(job, item)
            elif self._late():
                break
            if (now := time.monotonic()) > looked + LOOK_S / 2:
                looked = now
                self._give_up_overdue(job)
        self._close(job)
        return Evaluation(job.terms, job.valid, job.answered, np.empty(0, np.float32))

    def _job(self, request: PlanRequest, iteration: int, knots: np.ndarray) -> _Job:
        self._jobs += 1
        count, terms = len(knots), len(request.cost.weights)
        return _Job(
            *(self._jobs, request, iteration, knots, np.full((count, terms), np.nan)),
            *(np.zeros(count, bool), np.zeros(count, bool)),
            self._template(request, iteration, knots[:1]),
            *(count, [(0, count)]),
        )

    def _template(self, request: PlanRequest, iteration: int, knots: np.ndarray) -> Template:
        """Encode what all requests of a job share."""
        assert self._problem is not None, "begin() comes first"
        shared = RolloutRequest(
            run=self._bus.run or "",
            worker=self._asker,
            asker=self._asker,
            robot=self._bus.robot,
            number=request.number,
            iteration=iteration,
            shard=0,
            start=0,
            task=self._problem.task.source,
            task_hash=self._problem.hash,
            build=self._build,
            settings=self._settings,
            state=request.state,
            memory=request.memory,
            parameters=request.cost.parameters,
            knots=knots,
            reply_budget_ms=0.0,
            priority=self._priority,
        )
        return Template(shared, OWN)

    def _assign(self, job: _Job) -> None:
        """Give every row that is with nobody to the workers, so that all end soonest."""
        if not job.open or not (paces := self.workers.asked()):
            return
        ranges, job.open = job.open, []
        for start, count in ranges:
            if job.answered[start : start + count].all():  # by who was given up
                continue
            for worker, first, rows in split(start, count, paces):
                step = self._rows_a_request(rows, paces[worker])
                for offset in range(0, rows, step):
                    self._send(job, worker, first + offset, min(step, rows - offset))

    def _rows_a_request(self, rows: int, pace: Pace) -> int:
        return rows if self._deadline is None else chunk(pace, self._budget_ms(), REQUESTS)

    def _budget_ms(self) -> float:
        """Time until the deadline [ms]; 0 if there is none."""
        if self._deadline is None:
            return 0.0
        return max(1.0, (self._deadline - time.monotonic()) * 1e3)

    def _send(self, job: _Job, name: str, start: int, count: int, spare: bool = False) -> None:
        self._shard += 1
        now = time.monotonic()
        if (worker := self.workers.get(name)) is not None:
            worker.asked = now
            worker.turnaround.asked(job.number, self._shard, now)
        job.shards[self._shard] = _Shard(name, start, count, now, spare)
        payload = job.template.encode(
            worker=name,
            shard=self._shard,
            start=start,
            knots=job.knots[start : start + count],
            reply_budget_ms=self._budget_ms(),
        )
        self._bus.send(RolloutRequest, name, payload)

    def _next(self) -> "Heard | Change | None":
        """Wait for the next message, at most until something has to be decided."""
        began = time.monotonic()
        until = min(began + LOOK_S, np.inf if self._deadline is None else self._deadline)
        try:
            return self._inbox.get(timeout=max(0.0, until - began))
        except queue.Empty:
            return None
        finally:
            self.waited_s += time.monotonic() - began

    def _take(self, job: _Job, item: Heard | Change) -> None:
        if isinstance(item, Heard):
            self._accept(job, item.reply, item.at)
        elif self.workers.joined_or_left(item.member, item.alive):
            self._take_back(job, item.member.id)

    def _accept(self, job: _Job, reply: RolloutReply, at: float) -> None:
        """Enter a reply; anything that does not fit what was asked is refused, by name."""
        worker = self.workers.get(reply.worker)
        if worker is None:
            return  # the last words of one that has left
        self.workers.heard(worker)
        worker.leaving |= reply.leaving
        if reply.refusal:
            if reply.task_fails:
                self.workers.blamed(worker, reply.refusal)
                self._take_back(job, reply.worker)
            else:
                self._refused(job, reply, reply.refusal)
            return
        if not len(reply.valid):
            return  # it has only said that it is leaving
        shard = job.shards.get(reply.shard)
        if shard is None or (reply.number, reply.iteration) != (job.request.number, job.iteration):
            worker.answered(reply, at)
            return  # late: its plan has gone out
        rows = slice(shard.start, shard.start + shard.count)
        if (reply.start, reply.worker) != (shard.start, shard.worker) or (
            reply.terms.shape != job.terms[rows].shape or reply.valid.shape != (shard.count,)
        ):
            self._refused(job, reply, f"sent costs of shape {reply.terms.shape}")
            return
        worker.refusals = 0
        worker.answered(reply, at)
        job.enter(shard, reply)

    def _refused(self, job: _Job, reply: RolloutReply, reason: str) -> None:
        if (worker := self.workers.get(reply.worker)) is not None:
            self.workers.refused(worker, reason)
        self._take_back(job, reply.worker)

    def _take_back(self, job: _Job, worker: str) -> None:
        for shard in job.shards.values():
            if shard.worker == worker and not shard.done:
                self._abandon(job, shard)

    def _abandon(self, job: _Job, shard: _Shard) -> None:
        shard.done = True
        if not shard.spare:
            job.open.append((shard.start, shard.count))
            self.reissued += shard.count
            self._lose(shard)

    def _lose(self, shard: _Shard) -> None:
        shard.lost = True
        if worker := self.workers.get(shard.worker):
            worker.lost += shard.count

    def _late(self) -> bool:
        return self._deadline is not None and time.monotonic() >= self._deadline

    def _give_up_overdue(self, job: _Job) -> None:
        for shard in job.shards.values():
            if not shard.done and time.monotonic() - shard.sent >= RESEND_S:
                self.workers.missed(shard.worker)
                self._abandon(job, shard)

    def _close(self, job: _Job) -> None:
        """Note what was not answered in time, and who did not answer at all."""
        given, came, answered = Counter[str](), Counter[str](), set[str]()
        for shard in job.shards.values():
            if shard.spare:
                continue
            if shard.done:
                answered.add(shard.worker)
            else:
                self._lose(shard)
            given[shard.worker] += shard.count
            came[shard.worker] += 0 if shard.lost else shard.count
        for name, rows in given.items():
            if worker := self.workers.get(name):
                worker.took(came[name] / rows)
            if name not in answered:
                self.workers.missed(name)
