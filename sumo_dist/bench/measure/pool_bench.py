"""A router and an optimizer that are asked for plans, by a bench in the robot's place."""

import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sumo_dist.bench.measure.planning import request
from sumo_dist.bench.measure.pool_model import RolloutTimes
from sumo_dist.bench.measure.scripted import Process, Script
from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.dispatch.robot_link import RobotLink
from sumo_dist.episode.assemble import Episode
from sumo_dist.errors import SumoError
from sumo_dist.launch import serve
from sumo_dist.launch.launcher import Launcher, Service, listening
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.priority import goes_first, going_first
from sumo_dist.rollout import engine_identity
from sumo_dist.timing import TICK, anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import EpisodeInfo, PlanMessage

ANSWER_S = 60.0
PROCESSES = 2  # that play the scripted workers
WARM_UP = 3  # plans of each kind that are not counted
NEWEST = 100  # plans that are kept until they are looked at
WORKERS_RANK = 5  # of SCHED_RR: before other programs, behind what the plan waits for


class Made(NamedTuple):
    """Plans of a kind [ms]."""

    plan_ms: tuple[float, ...]  # as the robot sees them, each
    inside_ms: tuple[float, ...]  # as the optimizer sees them
    own_ms: tuple[float, ...]  # the optimizer's own time
    router_cpu_ms: float  # processor time of the router, mean
    optimizer_cpu_ms: float  # of the optimizer's whole process, mean

    @property
    def median_ms(self) -> float:
        """Median time of a plan."""
        return float(np.median(self.plan_ms))

    def plus(self, other: "Made | None") -> "Made":
        """Return these and as many others of the kind."""
        if other is None:
            return self
        return Made(
            self.plan_ms + other.plan_ms,
            self.inside_ms + other.inside_ms,
            self.own_ms + other.own_ms,
            (self.router_cpu_ms + other.router_cpu_ms) / 2,
            (self.optimizer_cpu_ms + other.optimizer_cpu_ms) / 2,
        )


@dataclass
class Bench:
    """A router and an optimizer that are asked for plans from a snapshot.

    Attributes:
        episode: that they plan for.
        endpoint: of the router.
        plans: of each kind that is timed.
    """

    episode: Episode
    snapshot: Snapshot
    endpoint: str
    plans: int
    engine: str
    _link: RobotLink
    _made: deque[PlanMessage]  # the newest plans
    _pids: dict[str, int]
    _number: int = 0

    @classmethod
    @contextmanager
    def start(
        cls, episode: Episode, snapshot: Snapshot, plans: int, engine: str
    ) -> "Iterator[Bench]":
        """Start them; what the plan waits for goes before all other programs if that may be."""
        endpoint, robot = listening("tcp/127.0.0.1:0"), episode.robot.name
        with Launcher() as launcher:
            # without fit: the bench says how many rollouts there are
            options = serve.Optimizer(connect=endpoint, robot=robot, engine=engine, fit=False)
            pids = {
                service.name: launcher.start(service).pid
                for service in (
                    Service("router", "router", serve.Router(endpoint)),
                    Service("optimizer", "optimizer", options),
                )
            }
            with going_first(), Bus.dial(endpoint, robot) as bus:
                link = RobotLink(bus, ANSWER_S, threading.Event(), lambda *_: None, lambda _: None)
                link.enter(
                    episode,
                    EpisodeInfo("bench", episode.config.to_json(), episode.problem.hash, 1),
                )
                made = deque[PlanMessage](maxlen=NEWEST)
                bus.subscribe(PlanMessage, made.append)
                yield cls(episode, snapshot, endpoint, plans, engine, link, made, pids)

    def plan(self, rollouts: int) -> PlanReport:
        """Make a plan."""
        self._number += 1
        settings = replace(self.episode.controls.planner, rollouts=rollouts)
        asked = request(self.episode, self.snapshot, self._number)
        return self._link.ask_plan(asked, settings)

    def timed(
        self, workers: int, rollouts: int, between: Callable[[], object] = lambda: None
    ) -> Made:
        """Make plans once so many workers answer; call something before each."""
        deadline = time.monotonic() + ANSWER_S
        while (there := self.plan(max(rollouts, 2 * workers)).workers) != workers:
            if time.monotonic() > deadline:
                raise SumoError(f"{there} of {workers} workers answered in {ANSWER_S:g} s")
        for _ in range(WARM_UP):
            self.plan(rollouts)
        before = {name: cpu_ms(pid) for name, pid in self._pids.items()}
        took, reports = [], list[PlanReport]()
        for _ in range(self.plans):
            between()
            began = time.perf_counter()
            reports.append(self.plan(rollouts))
            took.append((time.perf_counter() - began) * 1e3)
        cpu = {name: (cpu_ms(pid) - before[name]) / self.plans for name, pid in self._pids.items()}
        inside, own = zip(*((r.plan_ms, r.own_ms) for r in reports), strict=True)
        return Made(tuple(took), inside, own, cpu["router"], cpu["optimizer"])

    def in_time(self, workers: int, rollouts: int) -> float:
        """Ask for plans as a robot does in realtime; return the mean of rollouts that are in time.

        The workers have been asked before.
        """
        settings = replace(self.episode.controls.planner, rollouts=rollouts)
        in_time: list[int] = []
        plan: Plan | None = None
        self._number += 1
        tick, due = anchor_tick(self._number, settings.rate), time.monotonic()
        patience = due + ANSWER_S
        while len(in_time) < self.plans + WARM_UP:
            if time.monotonic() > patience:
                raise SumoError(f"{len(in_time)} plans of {workers} workers in {ANSWER_S:g} s")
            asked = self.episode.request(-1, tick, self.snapshot.state, self.snapshot.memory, plan)
            self._link.send_question(asked, settings, 1.0)
            tick, due = tick + 1, due + TICK
            time.sleep(max(0.0, due - time.monotonic()))
            while self._made:
                message = self._made.popleft()
                if message.plan.number >= self._number and len(message.costs) == rollouts:
                    in_time.append(rollouts - message.lost)
                    plan, self._number = message.plan, message.plan.number
        return float(np.mean(in_time[WARM_UP:]))

    @contextmanager
    def scripted(self, workers: int, times: RolloutTimes) -> Iterator[None]:
        """Have scripted workers at the router."""
        _, build = engine_identity(self.engine)
        names = [f"scripted-{i}" for i in range(workers)]
        with ExitStack() as stack:
            for i in range(min(PROCESSES, workers)):
                terms = len(self.episode.task.cost)
                script = Script(self.endpoint, names[i::PROCESSES], build, terms, times, seed=i)
                stack.enter_context(Process(script))
            yield
        self._until_gone()

    @contextmanager
    def real(self, workers: int) -> Iterator[None]:
        """Have real workers of one thread at the router, on this machine."""
        with Launcher() as launcher:
            for i in range(workers):
                options = serve.Worker(
                    connect=self.endpoint, name=f"real-{i}", engine=self.engine, give_way=False
                )
                prefix = before_others()
                launcher.start(Service(f"real-{i}", "rollout-worker", options, prefix=prefix))
            yield
        self._until_gone()

    def _until_gone(self) -> None:
        """Give the optimizer the time to see that workers have left."""
        time.sleep(0.5)


def cpu_ms(pid: int) -> float:
    """Processor time that a process has used [ms]; NaN where the kernel does not say."""
    try:
        told = [file.read_text("ascii") for file in Path(f"/proc/{pid}/task").glob("*/schedstat")]
    except OSError:
        return float("nan")
    return sum(int(text.split()[0]) for text in told) * 1e-6 if told else float("nan")


def before_others() -> tuple[str, ...]:
    """Return the command before a worker's that puts it before the machine's other programs.

    Where that may not be, they are what they would be anyway.
    """
    if not goes_first() or shutil.which("chrt") is None:
        return ()
    return "chrt", "--rr", str(WORKERS_RANK)
