"""What a session looks like now: messages in, one picture of it out, as JSON has it."""

import threading
import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from sumo_dist.control.floor import FloorPlan
from sumo_dist.control.offer import offer
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.tasks import load_task
from sumo_dist.timing import PLAN_PERIOD, TICK
from sumo_dist.wire.keys import OPERATOR, ROUTER, WORKER, Member, is_here, view_ports
from sumo_dist.wire.messages import (
    EpisodeEnd,
    EpisodeInfo,
    Message,
    PlanMessage,
    Question,
    State,
)
from sumo_dist.wire.notices import Ack, Event, Health, WorkerHealth, WorkerStatus

ALWAYS = (Event, Ack, Health, WorkerHealth)  # whatever the episode
SHOWN = (EpisodeInfo, State, Question, PlanMessage, EpisodeEnd, *ALWAYS)
EVENTS = 100  # that are kept
RATE_S = 2.0  # wall time over which rates are counted
SILENT_S = 2.0  # a worker of which nothing was heard for this long is left out
DIGITS = 5  # of numbers that are sent


class Picture:
    """Folds messages into what is shown of a session. Its methods may be called by any thread."""

    def __init__(self, robot: str) -> None:
        """Start without an episode.

        Args:
            robot: whose messages come.
        """
        self._robot = robot
        self._lock = threading.Lock()
        self._members: set[Member] = set()
        self._events: deque[dict[str, Any]] = deque(maxlen=EVENTS)
        self._told = 0  # events so far
        self._health: dict[str, tuple[float, Health]] = {}
        self._workers: dict[str, tuple[float, WorkerStatus]] = {}
        self._run = ""
        # The newest of each kind of an episode that is not known yet: topics have no order.
        self._early: dict[type[Message], Message] = {}
        self._begin()

    def _begin(self) -> None:
        """Forget an episode."""
        self.offer: dict[str, Any] | None = None
        self._floor: FloorPlan | None = None
        self._period_ms = PLAN_PERIOD * 1e3  # robot time between plans
        self._state: State | None = None
        self._question: Question | None = None
        self._plan: PlanMessage | None = None
        self._end: EpisodeEnd | None = None
        self._heard = 0.0  # time.monotonic() of the newest state
        self._missed = self._number = 0
        self._ticks: deque[tuple[float, int]] = deque()  # wall time and tick of states
        self._plans: deque[tuple[float, int]] = deque()

    def member(self, member: Member, alive: bool) -> None:
        """Take note of a service that has come or gone."""
        with self._lock:
            (self._members.add if alive else self._members.discard)(member)
            if member.role not in (ROUTER, OPERATOR):
                how = "is there" if alive else "is gone"
                self._event("info" if alive else "warning", f"{member.role} {member.id} {how}")

    def take(self, message: Message) -> None:
        """Take a message."""
        if isinstance(message, EpisodeInfo):
            self._enter(message)
            return
        with self._lock:
            if isinstance(message, ALWAYS) or message.run == self._run:
                self._take(message)
            else:
                self._early[type(message)] = message

    def _enter(self, info: EpisodeInfo) -> None:
        with self._lock:
            if info.run == self._run:
                return
            self._run = info.run
            self._begin()
            for message in self._early.values():
                if message.run == info.run:
                    self._take(message)
            self._early.clear()
        try:  # a second of compiling, in which messages of the next episode may wait
            config = EpisodeConfig.from_json(info.config)
            task = load_task(config.task)
            floor = FloorPlan(task)
            made = offer(config, task, floor)
        except SumoError as error:
            with self._lock:
                self._event("error", f"this episode cannot be steered from here: {error}")
            return
        with self._lock:
            if self._run == info.run:
                self.offer, self._floor = {**made, "run": info.run}, floor
                self._period_ms = config.planner.period * 1e3

    def _take(self, message: Message) -> None:
        now = time.monotonic()
        match message:
            case State() if self._state is None or message.tick > self._state.tick:
                self._state, self._heard = message, now
                _count(self._ticks, now, message.tick)
            case Question():
                self._question = message
                if self._state is None or message.tick > self._state.tick:
                    self._state = State(message.run, message.tick, message.state)
            case PlanMessage() if self._plan is None or message.order > self._plan.order:
                if self._plan is not None:
                    self._missed += message.plan.number - self._plan.plan.number - 1
                self._plan = message
                _count(self._plans, now, message.plan.number)
            case EpisodeEnd() if self._end is None:
                self._end = message
                level = "info" if message.success else "warning"
                self._event(level, f"the episode has ended: {message.reason}")
            case _:
                self._take_words(message, now)

    def _take_words(self, message: Message, now: float) -> None:
        match message:
            case Event():
                self._event(message.level, f"{message.source}: {message.text}")
            case Ack() if message.refusal:
                self._event("warning", f"refused to {message.sender}: {message.refusal}")
            case Health():
                self._health[message.source] = now, message
            case WorkerHealth():
                self._workers.update({told.worker: (now, told) for told in message.told})
            case _:
                pass  # in lockstep some come twice

    def _event(self, level: str, text: str) -> None:
        self._told += 1
        tick = self._state.tick if self._state is not None else 0
        self._events.append(
            {"number": self._told, "level": level, "text": text, "s": round(tick * TICK, 2)}
        )

    @property
    def view(self) -> tuple[int, int] | None:
        """Ports of this machine on which the tracer serves Rerun's page and its data, if any."""
        tracer = self._tracer
        return None if tracer is None else view_ports(tracer.build)

    @property
    def _tracer(self) -> Member | None:
        """Return the tracer of this machine that serves Rerun's page, if any."""
        return next(
            (
                member
                for member in self._members.copy()
                if member.role == "tracer" and is_here(member.id) and view_ports(member.build)
            ),
            None,
        )

    def snapshot(self) -> dict[str, Any]:
        """Return the picture, all but what `offer` has."""
        with self._lock:
            now = time.monotonic()
            return {
                "run": self._run,
                "robot": self._of_robot(now),
                "plan": self._of_plan(now),
                "numbers": self._numbers(),
                "floor": self._places(),
                "services": sorted({member.role for member in self._members}),
                "view": "" if (tracer := self._tracer) is None else tracer.id,
                "workers": self._of_workers(now),
                "events": list(self._events),
                "end": None if self._end is None else vars(self._end),
            }

    def _of_robot(self, now: float) -> dict[str, Any]:
        health = self._health.get("robot")
        mode = "gone" if health is None or now - health[0] > SILENT_S else health[1].mode
        tick = self._state.tick if self._state is not None else 0
        return {
            "name": self._robot,
            "mode": mode,
            "tick": tick,
            "s": round(tick * TICK, 2),
            "silent_s": round(now - self._heard, 1) if self._heard else None,
            "speed": _rounded(_rate(self._ticks, now) * TICK),
        }

    def _of_plan(self, now: float) -> dict[str, Any] | None:
        plan, question = self._plan, self._question
        if plan is None:
            return None
        speed = question.speed if question is not None and question.clock == "realtime" else 0.0
        finite = plan.costs[plan.finite]
        return {
            "number": plan.plan.number,
            "ms": _rounded(plan.plan_ms),
            "own_ms": _rounded(plan.own_ms),
            "period_ms": _rounded(self._period_ms),
            "budget_ms": _rounded(self._period_ms / speed) if speed > 0 else None,
            "age_ms": _rounded(plan.age_ticks * TICK * 1e3),
            "per_s": _rounded(_rate(self._plans, now)),
            "missed": self._missed,
            "rollouts": len(plan.costs),
            "lost": plan.lost,
            "reissued": plan.reissued,
            "invalid": plan.invalid,
            "failed": plan.failed,
            "workers": plan.workers,
            "terms": _numbers(plan.terms),
            "cost": _rounded(float(plan.terms.sum())),
            "best": _rounded(float(finite.min())) if len(finite) else None,
        }

    def _numbers(self) -> dict[str, Any] | None:
        """Return weights, parameters and settings of the newest question, and its tick."""
        question = self._question
        if question is None:
            return None
        return {
            "tick": question.tick,
            "weights": _numbers(question.weights),
            "parameters": _numbers(question.parameters),
            "settings": dict(question.settings),
        }

    def _places(self) -> dict[str, Any] | None:
        if self._floor is None or self._state is None:
            return None
        try:
            return self._floor.at(self._state.state)
        except UsageError:  # a state of another size: of another robot
            return None

    def _of_workers(self, now: float) -> list[dict[str, Any]]:
        alive = {member.id for member in self._members if member.role == WORKER}
        rows = []
        for name in sorted(
            alive | {n for n, (at, _) in self._workers.items() if now - at < SILENT_S}
        ):
            at, status = self._workers.get(name, (0.0, WorkerStatus(name, "", 0.0, 0, -1.0)))
            told = self._health.get(name)
            counters: Mapping[str, Any] = told[1].counters if told is not None else {}
            rows.append(
                {
                    "name": name,
                    "host": counters.get("host", ""),
                    "state": status.state if now - at < SILENT_S else "not asked",
                    "alive": name in alive,
                    "per_s": _rounded(status.rollouts_per_s),
                    "lost": status.lost,
                    "silent_s": _rounded(status.silent_s),
                }
            )
        return rows


def _count(counted: deque[tuple[float, int]], now: float, number: int) -> None:
    """Add a number, and forget those before the last RATE_S."""
    counted.append((now, number))
    while counted[0][0] < now - RATE_S:
        counted.popleft()


def _rate(counted: deque[tuple[float, int]], now: float) -> float:
    """How fast numbers grow by wall time [1/s], 0 if none has come for RATE_S."""
    if not counted or now - counted[-1][0] > RATE_S:
        return 0.0
    began, low = counted[0]
    return (counted[-1][1] - low) / max(now - began, RATE_S / 4)  # some may come in a burst


def _rounded(number: float) -> float:
    return float(f"{number:.{DIGITS}g}")


def _numbers(array: np.ndarray) -> list[float]:
    return [_rounded(number) for number in array.tolist()]
