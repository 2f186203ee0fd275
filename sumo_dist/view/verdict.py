"""How a run goes, in one line: late or not, how fast, who is slow, what is wrong."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from sumo_dist.planner.report import PlanReport
from sumo_dist.timing import TICK

RECENT_PLANS = 40  # that are judged; two seconds of robot time
LATE_SHARE = 0.1  # of recent plans over their budget, from which a run is late
PACE_S = 2.0  # wall time over which the robot's speed is measured

_AMISS = ("stopping", "stopped", "rising", "paused")  # modes of a robot that does not do its task
_SMALL = 1e-6  # [s]


@dataclass(frozen=True)
class _Worker:
    state: str
    rollouts_per_s: float


class Verdict:
    """Judges a run from what is told about it."""

    def __init__(self) -> None:
        """Start with nothing known."""
        self._plans: deque[tuple[PlanReport, float]] = deque(maxlen=RECENT_PLANS)
        self._ticks: deque[tuple[float, int]] = deque()  # (wall time [s], tick)
        self._workers: dict[str, _Worker] = {}
        self._alive: int | None = None
        self._most_alive = 0
        self._mode = "running"
        self._ended = ""

    def add_plan(self, report: PlanReport, budget_ms: float) -> None:
        """Take note of a plan that may have taken `budget_ms`."""
        self._plans.append((report, budget_ms))

    def add_tick(self, tick: int, now: float) -> None:
        """Take note of a tick seen at time.monotonic() `now` [s]."""
        self._ticks.append((now, tick))
        while self._ticks[0][0] < now - PACE_S and len(self._ticks) > 2:
            self._ticks.popleft()

    def add_worker(self, name: str, state: str, rollouts_per_s: float) -> None:
        """Take note of a worker: "answers" or why it is not asked, and how fast it is."""
        self._workers[name] = _Worker(state, rollouts_per_s)

    def remove_worker(self, name: str) -> None:
        """Take note that a worker has gone."""
        self._workers.pop(name, None)

    def set_alive(self, alive: int) -> None:
        """Take note of how many workers there are."""
        self._alive, self._most_alive = alive, max(alive, self._most_alive)

    def set_mode(self, mode: str) -> None:
        """Take note of what the robot does; see `RealtimeLoop.mode`."""
        self._mode = mode

    def end(self, reason: str, again: str) -> None:
        """Take note of how the run ended, and of the command that shows it again."""
        self._ended = f"**ended: {reason}**" + (f" · again with `{again}`" if again else "")

    def line(self) -> str:
        """Return the verdict, as Markdown."""
        if not self._plans:
            parts = [self._ended or "**no plan yet**"]
        else:
            parts = [self._ended, self._lateness(), self._speed(), self._slowest()]
        wrong = self._wrong()
        parts.append(f"**wrong: {'; '.join(wrong)}**" if wrong else "")
        return " · ".join(filter(None, parts))

    def _lateness(self) -> str:
        took = np.array([report.plan_ms for report, _ in self._plans])
        budgets = np.array([budget for _, budget in self._plans])
        budget, late = budgets[-1], (took > budgets).mean()
        if late > LATE_SHARE:
            share = f"{late:.0%} of plans over {budget:.0f} ms"
            return f"**late**: {share}, median {np.median(took):.0f} ms"
        return f"**on time**: plans take {np.median(took):.0f} of {budget:.0f} ms"

    def _speed(self) -> str:
        if len(self._ticks) > 1:
            (began, first), (now, last) = self._ticks[0], self._ticks[-1]
            return f"runs at {(last - first) * TICK / max(now - began, _SMALL):.2f} of real time"
        took, budget = np.median([report.plan_ms for report, _ in self._plans]), self._plans[-1][1]
        return f"planned at {min(1.0, budget / max(took, _SMALL)):.2f} of real time"

    def _slowest(self) -> str:
        answering = {n: w.rollouts_per_s for n, w in self._workers.items() if w.state == "answers"}
        if not answering:
            return ""
        name = min(answering, key=answering.__getitem__)
        return f"slowest worker {name}: {answering[name]:.0f} rollouts/s"

    def _wrong(self) -> list[str]:
        reports = [report for report, _ in self._plans]
        counts = {
            "rollouts lost": sum(report.lost for report in reports),
            "rollouts diverged": sum(report.invalid for report in reports),
            "plans failed, no candidate had a finite cost": sum(r.failed for r in reports),
        }
        wrong = [f"{count} {what}" for what, count in counts.items() if count]
        if self._alive is not None and self._alive < self._most_alive:
            gone = self._most_alive - self._alive
            wrong.append(f"{gone} of {self._most_alive} workers gone")
        elif self._alive == 0:
            wrong.append("no rollout worker")
        wrong += [f"worker {n} {w.state}" for n, w in self._workers.items() if w.state != "answers"]
        if self._mode in _AMISS and not self._ended:
            wrong.append(f"robot {self._mode}")
        return wrong
