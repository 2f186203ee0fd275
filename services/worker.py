"""Rolls out and costs candidate plans for whoever asks. Keeps nothing that a plan depends on.

A worker is started for no task: the first request names one, and it compiles that task itself.
"""

import logging
import threading
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np

from sumo_dist.costs.table import CostSettings
from sumo_dist.dispatch.workers import misfit
from sumo_dist.errors import SumoError, TaskError, UsageError
from sumo_dist.model.scene import ModelOptions
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation, Evaluator
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.priority import lower_priority
from sumo_dist.rollout import engine_identity
from sumo_dist.rollout.interface import Engine
from sumo_dist.services.inbox import Inbox
from sumo_dist.services.serving import Serving
from sumo_dist.tasks import load_task
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.connection import keys_for
from sumo_dist.wire.finding import Search, only_router
from sumo_dist.wire.health import Counters, Heartbeat
from sumo_dist.wire.keys import POOL, WORKER, Member, checked_name, unique_name
from sumo_dist.wire.messages import RolloutReply, RolloutRequest, Traces

ROUTER_WAIT_S = 10.0  # a worker may be started before the router
LOOK_S = 0.5  # between two looks for a router

log = logging.getLogger("sumo_dist.worker")


@dataclass(frozen=True)
class WorkerOptions:
    """A worker.

    Attributes:
        connect: the router's endpoint; by default that of the router on this machine. All robots
            there are served.
        keys: folder from `sumo-dist keys host`, for an endpoint with TLS.
        name: unique among the workers; by default host and process.
        threads: rollout threads.
        engine: kind of rollout engine, see rollout.make_engine.
        give_way: let other programs of this machine go first; with --no-give-way rollouts stay
            faster beside them, and they become slower.
    """

    connect: str | None = None
    keys: Path | None = None
    name: str = field(default_factory=unique_name)
    threads: int = 1
    engine: str = "auto"
    give_way: bool = True

    def __post_init__(self) -> None:
        checked_name("worker", self.name)
        if not 1 <= self.threads <= 256:
            raise UsageError(f"threads must be from 1 to 256, got {self.threads}")


def run(options: WorkerOptions, stop: threading.Event, aloud: bool = True) -> None:
    """Serve until told to stop.

    Args:
        options: the worker's.
        stop: tells it to stop.
        aloud: say whom it serves; in a run with many workers the optimizer speaks for them.

    Raises:
        SumoError: there is no router, or another worker has the name.
    """
    _, build = engine_identity(options.engine)
    if options.give_way:
        lower_priority()
    keys = keys_for(options.connect, options.keys, WORKER)
    endpoint, inbox = _router(options, stop), Inbox()
    if endpoint is None:
        return
    serving = Serving(endpoint, options.threads, aloud)
    with (
        Bus.dial(endpoint, POOL, timeout=ROUTER_WAIT_S, keys=keys) as bus,
        EvaluatorCache(options) as evaluators,
        Heartbeat(bus, options.name, evaluators.health),
    ):
        bus.subscribe(RolloutRequest, inbox.put, address=options.name)
        optimizers = bus.watch("optimizer", partial(_say_misfit, build))
        _claim_the_name(bus, options.name, endpoint)
        bus.announce(WORKER, options.name, build)
        while not stop.is_set():
            request = inbox.get(timeout=0.1)
            if request is None:
                serving.idle(optimizers.now)
                continue
            reply, traces = evaluators.answer(request)
            bus.publish(reply)
            serving.answered(request, reply)
            if traces is not None:
                bus.publish(traces)


def _router(options: WorkerOptions, stop: threading.Event) -> str | None:
    """Wait for a router; return its endpoint, None if told to stop.

    Raises:
        SumoError: there is none.
        UsageError: there are several on this machine.
    """
    began = time.monotonic()
    while options.connect is None and not stop.is_set():
        if routers := Search().look().routers:
            return only_router(routers)
        if time.monotonic() > began + ROUTER_WAIT_S:
            raise SumoError(
                f"no router on this machine (waited {ROUTER_WAIT_S:g} s): --connect names one "
                "elsewhere"
            )
        stop.wait(LOOK_S)
    return options.connect


def _say_misfit(build: str, optimizer: Member, alive: bool) -> None:
    """Say that an optimizer will not ask this worker, and why."""
    if alive and (reason := misfit(optimizer, build)):
        log.warning("optimizer %s cannot be served: %s", optimizer.id, reason)


def _claim_the_name(bus: Bus, name: str, endpoint: str) -> None:
    """Be the worker of this name: two of one name would answer each other's requests."""
    if not bus.watch(WORKER).vacant(lambda member: member.id == name):
        raise SumoError(
            f"a worker named {name!r} is at {endpoint} already: give this one another --name"
        )


class EvaluatorCache:
    """The problem that is worked on, and the newest answers, in case they are asked for again."""

    def __init__(self, options: WorkerOptions) -> None:
        """Start with no task."""
        self._options = options
        self._source: tuple[str, ModelOptions] | None = None  # task, what its model depends on
        self._problem: Problem | None = None
        self._engine: Engine | None = None
        self._evaluator: Evaluator | None = None
        self._config: PlannerConfig | None = None
        self._plan: tuple[str, int, int] | None = None
        self._answers: dict[bytes, tuple[Evaluation, float]] = {}
        self._done = self._refusals = 0  # requests answered and refused
        self._busy_ms = 0.0

    def health(self) -> tuple[str, Counters]:
        """How it is, for whoever watches."""
        task = self._source[0] if self._source else ""
        counters = {"answered": self._done, "refused": self._refusals, "task": task}
        return "worker", {**counters, "busy s": round(self._busy_ms / 1e3, 1)}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def answer(self, request: RolloutRequest) -> tuple[RolloutReply, Traces | None]:
        """Roll out a shard; what cannot be done is a reply that says why."""
        try:
            evaluation, compute_ms = self._evaluate(request)
        except SumoError as error:
            self._refusals += 1
            nothing = np.empty((0, 0)), np.empty(0, bool)
            own = isinstance(error, TaskError)
            return self._reply(request, *nothing, refusal=str(error), task_fails=own), None
        self._done, self._busy_ms = self._done + 1, self._busy_ms + compute_ms
        valid = evaluation.valid & np.isfinite(evaluation.terms).all(axis=1)
        terms = np.where(valid[:, None], evaluation.terms, 0.0)
        traces = Traces(
            request.run,
            self._options.name,
            request.robot,
            request.number,
            request.iteration,
            request.start,
            np.nan_to_num(evaluation.traces),
        )
        return self._reply(request, terms, valid, compute_ms), traces

    def _evaluate(self, request: RolloutRequest) -> tuple[Evaluation, float]:
        evaluator = self._prepare(request)
        assert self._problem is not None, "it was compiled"
        table = self._problem.task.table
        table.check(CostSettings(table.defaults.weights, request.parameters))
        plan = (request.run, request.number, request.iteration)
        if plan != self._plan:
            self._plan, self._answers = plan, {}
        # A number may be asked for twice with another content: by a restarted optimizer.
        question = request.state, request.memory, request.parameters, request.knots
        content = b"".join(array.tobytes() for array in question)
        if content not in self._answers:
            began = time.perf_counter()
            evaluation = evaluator(*question)
            self._answers[content] = evaluation, (time.perf_counter() - began) * 1e3
        return self._answers[content]

    def _prepare(self, request: RolloutRequest) -> Evaluator:
        """Compile what the request is about, unless that is what the last one was about."""
        config = PlannerConfig.from_settings(request.settings)
        source = request.task, planning_options(config)
        if source != self._source or self._hash() != request.task_hash:  # or its files changed
            self._compile(*source)
        if self._hash() != request.task_hash:
            raise SumoError(
                f"its {request.task} has hash {self._hash()}, the optimizer's has "
                f"{request.task_hash}: the task's files differ between the hosts"
            )
        if self._evaluator is None or config != self._config:
            assert self._problem is not None and self._engine is not None, "it was compiled"
            self._evaluator = Evaluator(self._problem, self._engine, config)
            self._config, self._answers = config, {}
        return self._evaluator

    def _hash(self) -> str:
        return self._problem.hash if self._problem is not None else ""

    def _compile(self, task: str, options: ModelOptions) -> None:
        self._close()
        self._problem = Problem.build(load_task(task), options)
        self._engine = self._problem.engine(self._options.threads, self._options.engine)
        self._source = task, options

    def _close(self) -> None:
        if self._engine is not None:
            self._engine.close()
        self._source = self._problem = self._engine = self._evaluator = self._plan = None
        self._answers = {}

    def _reply(
        self,
        request: RolloutRequest,
        terms: np.ndarray,
        valid: np.ndarray,
        compute_ms: float = 0.0,
        refusal: str = "",
        task_fails: bool = False,
    ) -> RolloutReply:
        return RolloutReply(
            run=request.run,
            worker=self._options.name,
            asker=request.asker,
            number=request.number,
            iteration=request.iteration,
            shard=request.shard,
            start=request.start,
            terms=terms,
            valid=valid,
            compute_ms=compute_ms,
            refusal=refusal,
            task_fails=task_fails,
        )
