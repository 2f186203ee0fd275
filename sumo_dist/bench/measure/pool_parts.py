"""Measuring what `pool_model` is fed with, and the plans that it is compared with.

Plans are made by the real optimizer through the real router. The bench stands in for the robot.
"""

import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from sumo_dist.bench.measure.planning import request
from sumo_dist.bench.measure.pool_model import Parts, RolloutTimes
from sumo_dist.bench.measure.scripted import Process, Script
from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.dispatch.robot_link import RobotLink
from sumo_dist.episode.assemble import Episode
from sumo_dist.errors import SumoError
from sumo_dist.launch import serve
from sumo_dist.launch.launcher import Launcher, Service, listening
from sumo_dist.planner.evaluate import Evaluation, Evaluator
from sumo_dist.planner.planner import Planner, PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.priority import go_first, goes_first
from sumo_dist.rollout import engine_identity
from sumo_dist.terminal import say
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import EpisodeInfo

ANSWER_S = 60.0
SIZES = (1, 2, 4, 8, 16, 32)  # rows of a request whose rollout is timed
DELAY_MS = 60.0  # of scripted workers whose messages are timed: all are asked before one answers
PROCESSES = 2  # that play the scripted workers
WARM_UP = 3
FEW = 8  # workers that plans with more rows a request, and with idle workers, are timed with
MANY_ROWS = 8  # of such a request
REST = 0.15  # after a rollout, as a share of its time
WORKERS_RANK = 5  # of SCHED_RR: before other programs, behind what the plan waits for


class Made(NamedTuple):
    """Plans of a kind [ms]."""

    plan_ms: tuple[float, ...]  # as the robot sees them, each
    own_ms: tuple[float, ...]  # the optimizer's own time of each
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
            options = serve.Optimizer(connect=endpoint, robot=robot, engine=engine)
            pids = {
                service.name: launcher.start(service).pid
                for service in (
                    Service("router", "router", serve.Router(endpoint)),
                    Service("optimizer", "optimizer", options),
                )
            }
            go_first()
            with Bus.dial(endpoint, robot) as bus:
                link = RobotLink(
                    bus, ANSWER_S, threading.Event(), lambda _, text: say(text), lambda _: None
                )
                link.enter(
                    episode,
                    EpisodeInfo("bench", episode.config.to_json(), episode.problem.hash, 1),
                )
                yield cls(episode, snapshot, endpoint, plans, engine, link, pids)

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
        took, own = [], []
        for _ in range(self.plans):
            between()
            began = time.perf_counter()
            report = self.plan(rollouts)
            took.append((time.perf_counter() - began) * 1e3)
            own.append(report.own_ms)
        cpu = {name: (cpu_ms(pid) - before[name]) / self.plans for name, pid in self._pids.items()}
        return Made(tuple(took), tuple(own), cpu["router"], cpu["optimizer"])

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


def overheads(bench: Bench, workers: Sequence[int]) -> dict[tuple[int, int], Made]:
    """Time plans by (workers, rollouts) with workers that all answer after the same time.

    A row each for all numbers of workers; and for a few of them, more rows, and more workers that
    are not asked. All are timed upwards and again downwards: what drifts counts for all alike.
    """
    few, most = min(FEW, max(workers)), max(workers)
    counts = sorted({1, few, *workers})
    found: dict[tuple[int, int], Made] = {}
    for count in (*counts, *reversed(counts)):
        wanted = {count, *([MANY_ROWS * few] if count == few else []), *([few] * (count == most))}
        with bench.scripted(count, RolloutTimes.fixed(DELAY_MS)):
            for rollouts in sorted(wanted):
                kind = count, rollouts
                found[kind] = bench.timed(*kind).plus(found.get(kind))
        say(f"plans of {count} workers timed")
    return found


def parts(rollout: RolloutTimes, found: Mapping[tuple[int, int], Made]) -> Parts:
    """Return what the model needs, from rollout times and what `overheads` returns."""
    took = {kind: made.median_ms - DELAY_MS for kind, made in found.items()}
    counts = sorted({workers for workers, _ in found})
    few, most = min(FEW, counts[-1]), counts[-1]
    more_rows = took[few, MANY_ROWS * few] - took[few, few]
    idle = took[most, few] - took[few, few]
    grows = np.maximum.accumulate([took[count, count] - took[1, 1] for count in counts])
    return Parts(
        rollout,
        base_ms=took[1, 1],
        requests=counts,
        overhead_ms=grows.tolist(),
        row_ms=max(0.0, more_rows) / (few * (MANY_ROWS - 1)),
        idle_ms=max(0.0, idle) / max(1, most - few),
    )


class RolloutTimer:
    """Times rollouts on one thread of this process. A context manager."""

    def __init__(self, episode: Episode, snapshot: Snapshot, engine: str) -> None:
        """Plan from a snapshot."""
        self._episode, self._snapshot = episode, snapshot
        config = episode.controls.planner
        self._planner = Planner(config, episode.task.actions, episode.config.seed)
        self._engine = episode.problem.engine(1, engine)
        self._evaluator = Evaluator(episode.problem, self._engine, config)
        self._number = 0
        self._took_ms = 0.0
        for size in SIZES:  # the first are slow
            self(size)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.close()

    def __call__(self, size: int) -> float:
        """Return the processor time of a request of so many rows [ms]: what it takes undisturbed.

        Then rest: the kernel holds up what has real-time priority and is never idle.
        """
        self._number += 1
        asked = request(self._episode, self._snapshot, self._number)
        self._planner.plan(asked, self._evaluate, size)
        time.sleep(REST * self._took_ms * 1e-3)
        return self._took_ms

    def _evaluate(self, asked: PlanRequest, _: int, knots: np.ndarray) -> Evaluation:
        began = time.process_time()
        found = self._evaluator(asked.state, asked.memory, asked.cost.parameters, knots)
        self._took_ms = (time.process_time() - began) * 1e3
        return found

    def times(self, repeats: int) -> RolloutTimes:
        """Time all sizes in turn."""
        samples: dict[int, list[float]] = {size: [] for size in SIZES}
        for _ in range(repeats):
            for size, of_it in samples.items():
                of_it.append(self(size))
        return RolloutTimes.of(samples)
