"""Rolls out and costs candidate plans for whoever asks. Keeps nothing that a plan depends on.

A worker is started for no task: the first request names one, and it compiles that task itself.
"""

import logging
import socket
import threading
import time
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import tyro

from sumo_dist.costs.table import CostSettings
from sumo_dist.dispatch.workers import misfit
from sumo_dist.errors import SumoError, TaskError, UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation
from sumo_dist.planner.problem import planning_options
from sumo_dist.priority import lower_priority
from sumo_dist.rollout import engine_identity
from sumo_dist.services.compiled import CompiledProblems
from sumo_dist.services.inbox import Inbox
from sumo_dist.services.serving import Serving
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.connection import keys_for
from sumo_dist.wire.finding import router_here
from sumo_dist.wire.health import Counters, Heartbeat
from sumo_dist.wire.keys import POOL, WORKER, Member, checked_name, unique_name
from sumo_dist.wire.messages import RolloutReply, RolloutRequest, Traces
from sumo_dist.wire.notices import Drain

ROUTER_WAIT_S = 10.0  # a worker may be started before the router
LOOK_S = 0.5  # between two looks for a router
DRAIN_S = 3.0  # that a worker which is told to stop goes on answering, at most
QUIET_S = 0.1  # nobody has asked for so long: those who know it have heard that it leaves
ASKED_S = 5.0  # who has asked within this time is told that it leaves

log = logging.getLogger("sumo_dist.worker")


@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """A worker.

    Attributes:
        connect: the router's endpoint; by default that of the router on this machine. All robots
            there are served.
        keys: folder from `sumo-dist keys host`, for an endpoint with TLS.
        name: unique among the workers; by default host and process.
        threads: rollout threads. A worker of one thread a core is as fast as one of many threads,
            and what it is late with, or lost with it, is less.
        engine: kind of rollout engine, see rollout.make_engine.
        trust: task files that it may run, or folders of such. Tasks by name need none: they are of
            what is installed.
        give_way: let other programs of this machine go first; with --no-give-way rollouts stay
            faster beside them, and they become slower.
    """

    connect: str | None = None
    keys: Path | None = None
    name: str = field(default_factory=unique_name)
    threads: int = 1
    engine: str = "auto"
    trust: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction] = ()
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
        bus.subscribe(Drain, partial(_leave, stop), address=options.name)
        optimizers = bus.watch("optimizer", partial(_say_misfit, build))
        _claim_the_name(bus, options.name, endpoint)
        bus.announce(WORKER, options.name, build)
        leaving = Leaving(inbox, bus, evaluators)
        while not (stop.is_set() and leaving.over()):
            request = inbox.get(timeout=0.1 if not stop.is_set() else QUIET_S)
            if request is None:
                serving.idle(optimizers.now)
                continue
            reply, traces = evaluators.answer(request)
            bus.publish(replace(reply, leaving=stop.is_set()))
            serving.answered(request, reply)
            if traces is not None:
                bus.publish(traces)


def _leave(stop: threading.Event, drain: Drain) -> None:
    if not stop.is_set():  # else it was said again
        log.info("%s has told this worker to end", drain.sender)
    stop.set()


class Leaving:
    """The end of a worker that was told to stop: it is asked no more and answers what it was."""

    def __init__(self, inbox: Inbox, bus: Bus, evaluators: "EvaluatorCache") -> None:
        """Prepare."""
        self._inbox, self._bus, self._evaluators = inbox, bus, evaluators
        self._deadline: float | None = None  # time.monotonic()

    def over(self) -> bool:
        """Whether nothing is left to answer. The first call tells those who have asked of late."""
        now = time.monotonic()
        if self._deadline is None:
            self._deadline = now + DRAIN_S
            for request in self._inbox.last(ASKED_S):
                self._bus.publish(self._evaluators.nothing(request, leaving=True))
        return now > self._deadline or not self._inbox.last(QUIET_S)


def _router(options: WorkerOptions, stop: threading.Event) -> str | None:
    """Wait for a router; return its endpoint, None if told to stop.

    Raises:
        SumoError: there is none.
        UsageError: there are several on this machine.
    """
    began = time.monotonic()
    while options.connect is None and not stop.is_set():
        if (endpoint := router_here()) is not None:
            return endpoint
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
    """Answers requests with the problems that are compiled."""

    def __init__(self, options: WorkerOptions) -> None:
        """Start with no task."""
        self._options = options
        self._problems = CompiledProblems(options.threads, options.engine, options.trust)
        self._task = ""  # the last one
        self._done = self._refusals = 0  # requests answered and refused
        self._busy_ms = 0.0

    def health(self) -> tuple[str, Counters]:
        """How it is, for whoever watches."""
        return "worker", {
            "host": socket.gethostname(),
            "answered": self._done,
            "refused": self._refusals,
            "task": self._task,
            "busy s": round(self._busy_ms / 1e3, 1),
        }

    def __enter__(self) -> Self:
        self._problems.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._problems.__exit__(*error)

    def answer(self, request: RolloutRequest) -> tuple[RolloutReply, Traces | None]:
        """Roll out a shard; what cannot be done is a reply that says why."""
        try:
            evaluation, compute_ms = self._evaluate(request)
        except SumoError as error:
            self._refusals += 1
            own = isinstance(error, TaskError)
            return self.nothing(request, refusal=str(error), task_fails=own), None
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
        return request.reply(terms, valid, compute_ms, self._options.threads), traces

    def nothing(self, request: RolloutRequest, **changes: Any) -> RolloutReply:
        """Return a reply without costs."""
        reply = request.reply(np.empty((0, 0)), np.empty(0, bool), threads=self._options.threads)
        return replace(reply, **changes)

    def _evaluate(self, request: RolloutRequest) -> tuple[Evaluation, float]:
        config = PlannerConfig.from_settings(request.settings)
        if (rows := len(request.knots)) > config.rollouts:
            raise SumoError(f"{rows} rows of a plan of {config.rollouts} rollouts")
        options = planning_options(config)
        compiled = self._problems.get(request.task, options, request.task_hash)
        self._task = request.task
        table = compiled.problem.task.table
        table.check(CostSettings(table.defaults.weights, request.parameters))
        plan = request.run, request.number, request.iteration, config
        answers = compiled.answers(request.asker, plan)
        # A number may be asked for twice with another content: by a restarted optimizer.
        question = request.state, request.memory, request.parameters, request.knots
        content = b"".join(array.tobytes() for array in question)
        if content not in answers:
            began = time.perf_counter()
            evaluation = compiled.evaluator(config)(*question)
            answers[content] = evaluation, (time.perf_counter() - began) * 1e3
        return answers[content]
