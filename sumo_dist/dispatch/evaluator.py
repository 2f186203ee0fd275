"""Rolling out candidates on workers across the bus: shards out, costs back, nobody waited for."""

import queue
import secrets
import threading
import time
from dataclasses import asdict, dataclass, field

import numpy as np

from sumo_dist.dispatch.sharding import split
from sumo_dist.dispatch.workers import Workers
from sumo_dist.errors import Interrupted, TaskError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.problem import Problem
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.events import Tell
from sumo_dist.wire.keys import WORKER, Member
from sumo_dist.wire.messages import RolloutReply, RolloutRequest

RESEND_S = 1.0  # a shard unanswered for this long goes to another worker
CHUNK = 8  # rows a request when there is a deadline, so that a late worker is late with few


@dataclass(frozen=True)
class Change:
    """A worker joined or left."""

    member: Member
    alive: bool


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
            if not shard.done and not shard.spare:
                free[shard.start : shard.start + shard.count] = False
        edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
        return [(int(a), int(b - a)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


class RemoteEvaluator:
    """Evaluates candidates on whatever workers are alive. One plan at a time.

    Without a deadline every candidate is sent again until somebody has answered it; with one, what
    is late is left out. A worker that leaves gives up its shards at once.

    Attributes:
        workers: all that are known.
        reissued: rows sent a second time for this plan.
        waited_s: time spent waiting for workers for this plan.
    """

    def __init__(self, bus: Bus, name: str, build: str, stop: threading.Event, tell: Tell) -> None:
        """Subscribe to replies and members.

        Args:
            bus: of the robot.
            name: of the optimizer; replies come to it alone.
            build: that workers must have.
            stop: ends the waiting.
            tell: `tell(level, text)` hears what users should know.
        """
        self._bus, self._build, self._stop = bus, build, stop
        # Of this process alone: one that is restarted does not take its predecessor's answers.
        self._asker = f"{name[:50]}-{secrets.token_hex(4)}"
        self._inbox: queue.SimpleQueue[RolloutReply | Change] = queue.SimpleQueue()
        self._shard = 0  # the last one's
        self._problem: Problem | None = None
        self._settings: dict[str, int | float | str] = {}
        self._deadline: float | None = None
        self.workers = Workers(build, tell)
        self.reissued = 0
        self.waited_s = 0.0
        bus.subscribe(RolloutReply, self._inbox.put, address=self._asker)
        bus.watch(WORKER, lambda member, alive: self._inbox.put(Change(member, alive)))

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
        if asdict(settings) != self._settings or problem is not self._problem:
            self.workers.measure_again()
        self._problem, self._settings = problem, asdict(settings)
        self._deadline, self.reissued, self.waited_s = deadline, 0, 0.0

    def __call__(self, request: PlanRequest, iteration: int, knots: np.ndarray) -> Evaluation:
        """Evaluate knots (B, K, n); rows nobody answered in time come back unanswered.

        Raises:
            TaskError: the task's own code raises on every worker.
            Interrupted: told to stop.
        """
        count = len(knots)
        job = _Job(
            request,
            iteration,
            knots,
            np.full((count, len(request.cost.weights)), np.nan),
            np.zeros(count, bool),
            np.zeros(count, bool),
        )
        while not self._inbox.empty():  # who came and went since the last plan
            self._take(job, self._inbox.get())
        self._try_others(job)
        while not job.answered.all():
            if self._stop.is_set():
                raise Interrupted("told to stop while waiting for rollouts")
            if reason := self.workers.verdict:
                raise TaskError(reason)
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

    def _try_others(self, job: _Job) -> None:
        """Give workers that have not shown themselves yet a row that another rolls out, too."""
        for name in self.workers.to_try():
            self._send(job, name, 0, 1, spare=True)

    def _assign(self, job: _Job) -> None:
        """Give every row that is with nobody to the workers, by speed."""
        speeds = self.workers.asked()
        if not speeds:
            return
        for start, count in job.open_rows():
            for worker, first, rows in split(start, count, speeds):
                chunk = rows if self._deadline is None else CHUNK
                for offset in range(0, rows, chunk):
                    self._send(job, worker, first + offset, min(chunk, rows - offset))

    def _send(self, job: _Job, name: str, start: int, count: int, spare: bool = False) -> None:
        assert self._problem is not None, "begin() comes first"
        self._shard += 1
        now = time.monotonic()
        if (worker := self.workers.get(name)) is not None:
            worker.asked = now
        job.shards[self._shard] = _Shard(name, start, count, now, spare)
        budget = 0.0 if self._deadline is None else max(1e-3, self._deadline - now)
        request = job.request
        self._bus.publish(
            RolloutRequest(
                run=self._bus.run or "",
                worker=name,
                asker=self._asker,
                robot=self._bus.robot,
                number=request.number,
                iteration=job.iteration,
                shard=self._shard,
                start=start,
                task=self._problem.task.source,
                task_hash=self._problem.hash,
                build=self._build,
                settings=self._settings,
                state=request.state,
                memory=request.memory,
                parameters=request.cost.parameters,
                knots=job.knots[start : start + count],
                reply_budget_ms=budget * 1e3,
            )
        )

    def _next(self, job: _Job) -> "RolloutReply | Change | None":
        """Wait for the next message, at most until something has to be decided."""
        due = min((s.sent + RESEND_S for s in job.shards.values() if not s.done), default=np.inf)
        until = min(due, self._deadline if self._deadline is not None else np.inf)
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
        elif self.workers.joined_or_left(item.member, item.alive):
            self._take_back(job, item.member.id)

    def _accept(self, job: _Job, reply: RolloutReply) -> None:
        """Enter a reply; anything that does not fit what was asked is refused, by name."""
        worker = self.workers.get(reply.worker)
        if worker is None:
            return  # the last words of one that has left
        self.workers.heard(worker)
        if reply.refusal:
            if reply.task_fails:
                self.workers.blamed(worker, reply.refusal)
                self._take_back(job, reply.worker)
            else:
                self._refused(job, reply, reply.refusal)
            return
        worker.answered(len(reply.valid), reply.compute_ms)
        shard = job.shards.get(reply.shard)
        if shard is None or (reply.number, reply.iteration) != (job.request.number, job.iteration):
            return  # late: its plan has gone out
        rows = slice(shard.start, shard.start + shard.count)
        if (reply.start, reply.worker) != (shard.start, shard.worker) or (
            reply.terms.shape != job.terms[rows].shape or reply.valid.shape != (shard.count,)
        ):
            self._refused(job, reply, f"sent costs of shape {reply.terms.shape}")
            return
        shard.done, worker.refusals = True, 0
        job.terms[rows] = np.where(reply.valid[:, None], reply.terms, np.nan)
        job.valid[rows], job.answered[rows] = reply.valid, True

    def _refused(self, job: _Job, reply: RolloutReply, reason: str) -> None:
        if (worker := self.workers.get(reply.worker)) is not None:
            self.workers.refused(worker, reason)
        self._take_back(job, reply.worker)

    def _take_back(self, job: _Job, worker: str) -> None:
        for shard in job.shards.values():
            if shard.worker == worker and not shard.done:
                self._abandon(shard)

    def _abandon(self, shard: _Shard) -> None:
        shard.done = True
        if not shard.spare:
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
                self._abandon(shard)

    def _close(self, job: _Job) -> None:
        """Note what was not answered in time, and who did not answer at all."""
        needed = [shard for shard in job.shards.values() if not shard.spare]
        for shard in needed:
            if not shard.done:
                self._lose(shard)
        for name in {shard.worker for shard in needed}:
            given = [shard for shard in needed if shard.worker == name]
            if worker := self.workers.get(name):
                worker.took(sum(s.count for s in given if not s.lost) / sum(s.count for s in given))
            if not any(shard.done for shard in given):
                self.workers.missed(name)
