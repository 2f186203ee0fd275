"""Makes the plans: shift, sample, send knots to workers, gather costs, update, publish.

It keeps no plan that the robot does not have: each plan starts from the state and the plan that
the robot reports, so an optimizer that is restarted goes on where the last one ended.
"""

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace

import numpy as np

from sumo_dist.dispatch.evaluator import RemoteEvaluator
from sumo_dist.dispatch.fit import fitted
from sumo_dist.episode.follow import misfit
from sumo_dist.errors import Interrupted, SumoError
from sumo_dist.planner.compensate import roll_forward
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import Planner, PlanRequest
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.planner.report import PlanReport
from sumo_dist.rollout import engine_identity
from sumo_dist.rollout.interface import Engine
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK, anchor_tick, plan_due
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.events import Tell, teller
from sumo_dist.wire.health import Counters, Pulse
from sumo_dist.wire.keys import BY_HAND
from sumo_dist.wire.messages import PlanMessage, State, Status
from sumo_dist.wire.session import DEFAULT_ENDPOINT

Wanted = Callable[[Status], bool]

PERIOD = 0.05  # robot time between plans [s]
SEND_MARGIN = 0.004  # wall time kept for the update and the plan's way to the robot [s]


@dataclass(frozen=True)
class OptimizerOptions:
    """An optimizer.

    Attributes:
        task: its name.
        connect: the router's endpoint.
        robot: whose plans to make.
        run: the run to plan for; others' messages are dropped.
        planner: the planner's settings.
        seed: of the sampling noise.
        engine: kind of rollout engine that workers must have, see rollout.make_engine.
        compensate: in realtime, plan from where the robot will be when the plan arrives.
        fit: in realtime, make fewer rollouts when the workers cannot do all of them in time.
    """

    task: str
    connect: str = DEFAULT_ENDPOINT
    robot: str = "spot"
    run: str = BY_HAND
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    seed: int = 0
    engine: str = "auto"
    compensate: bool = True
    fit: bool = True


def run(options: OptimizerOptions, stop: threading.Event) -> None:
    """Serve until told to stop."""
    task = load_task(options.task)
    problem = Problem.build(task, planning_options(options.planner))
    _, build = engine_identity(options.engine)
    with (
        problem.engine(1, options.engine) as engine,
        Bus.dial(options.connect, options.robot, run=options.run) as bus,
        ExitStack() as stack,
    ):
        tell = teller(bus, options.run, "optimizer")
        evaluator = RemoteEvaluator(bus, options.run, problem, options.planner, build, stop, tell)
        feed, service = Feed(bus), Service(options, bus, problem, engine, evaluator, tell)
        stack.enter_context(Pulse(bus, options.run, "optimizer", service.health))
        bus.announce("optimizer", "main", build)
        while not stop.is_set():
            snapshot = feed.wait(service.wants, timeout=0.1)
            if snapshot is None:
                continue
            try:
                service.handle(*snapshot)
            except Interrupted:
                return
            except SumoError as error:  # of a question that makes no sense, not of this service
                service.refuse(str(error))


class Feed:
    """Joins the robot's status with the state of the same tick; hands out each newest pair once.

    A realtime run's speed counts once two statuses in a row have said it: it decides how long a
    plan waits for lost answers, and where it is anchored, so one that lies would stop planning.
    """

    def __init__(self, bus: Bus) -> None:
        """Subscribe."""
        self._arrived = threading.Condition()
        self._states: dict[int, State] = {}
        self._status: Status | None = None
        self._heard = (-1, 0.0)  # tick and speed of the last realtime status
        self._speed = 0.0  # that two in a row have said
        bus.subscribe(State, self._on_state)
        bus.subscribe(Status, self._on_status)

    def wait(self, wanted: Wanted, timeout: float) -> tuple[State, Status] | None:
        """Return the newest pair if it is `wanted(status)`, waiting at most timeout [s] for it."""
        with self._arrived:
            self._arrived.wait_for(lambda: self._pair(wanted) is not None, timeout)
            pair = self._pair(wanted)
            if pair is not None:
                self._status = None
            return pair

    def _pair(self, wanted: Wanted) -> tuple[State, Status] | None:
        status = self._status
        if status is None or status.tick not in self._states or not wanted(status):
            return None
        return self._states[status.tick], status

    def _on_state(self, state: State) -> None:
        with self._arrived:
            self._states.pop(state.tick, None)
            self._states[state.tick] = state
            for tick in list(self._states)[:-8]:  # by arrival: one of a wrong tick goes as well
                del self._states[tick]
            self._arrived.notify_all()

    def _on_status(self, status: Status) -> None:
        with self._arrived:
            if status.clock == "realtime":
                tick, speed = self._heard
                if status.speed == speed and status.tick != tick:  # not the same one twice
                    self._speed = speed
                self._heard = status.tick, status.speed
                status = replace(status, speed=self._speed)
            self._status = status
            self._arrived.notify_all()


class Service:
    """One plan at a time, for both clocks."""

    def __init__(
        self,
        options: OptimizerOptions,
        bus: Bus,
        problem: Problem,
        engine: Engine,
        evaluator: RemoteEvaluator,
        tell: Tell,
    ) -> None:
        """Join the parts."""
        self._tell = tell
        self._options, self._bus, self._engine, self._evaluator = options, bus, engine, evaluator
        self._actions = problem.task.actions
        self._planner = Planner(options.planner, self._actions, options.seed)
        self._last: PlanMessage | None = None
        self._last_clock, self._last_state = "", np.empty(0)  # what the last plan was made for
        self._failing = False
        self._fewer = False  # rollouts than configured
        self._refused = 0  # questions that made no sense
        self._delay_s = 0.0  # smoothed wall time from a state to its plan

    def wants(self, status: Status) -> bool:
        """Whether a plan is to be made (or sent again) now."""
        if status.clock != "realtime":
            return status.wanted >= 0
        return status.speed > 0 and self._target(status) is not None

    def refuse(self, reason: str) -> None:
        """Take note of a question that cannot be answered."""
        self._refused += 1
        if self._refused == 1:
            self._tell("error", f"a plan that cannot be made: {reason}; from now on only counted")

    def health(self) -> tuple[str, Counters]:
        """How it is, for whoever watches."""
        last = self._last
        counters: dict[str, int | float | str] = {
            "workers": self._evaluator.workers,
            "refused": self._refused,
            **self._evaluator.workers_health(),
        }
        if last is not None:
            counters |= {
                "plan": last.plan.number,
                "plan ms": round(last.plan_ms, 1),
                "age ticks": last.age_ticks,
                "rollouts": len(last.costs),
                "lost": last.lost,
                "reissued": last.reissued,
            }
        return "failing" if self._failing else self._last_clock or "waiting", counters

    def handle(self, state: State, status: Status) -> None:
        """Make and publish the plan that a status asks for, or repeat the one it has missed.

        Raises:
            SumoError: state, memory or plan are not of this robot.
        """
        if status.followed is not None and (wrong := misfit(status.followed, self._actions)):
            raise SumoError(f"the followed plan is none of this robot: {wrong}")
        if status.clock == "realtime":
            self._plan_realtime(state, status)
        elif (
            self._last
            and (self._last_clock, self._last.plan.number) == (status.clock, status.wanted)
            and np.array_equal(self._last_state, state.state)  # else the robot was started again
        ):
            self._bus.publish(self._last)
        else:
            self._plan_lockstep(state, status)

    def _plan_lockstep(self, state: State, status: Status) -> None:
        self._evaluator.reset_account(deadline=None)
        request = PlanRequest(
            status.wanted, state.tick, state.state, status.memory, status.followed
        )
        self._publish(self._make(request, time.perf_counter()), status.clock, state)

    def _plan_realtime(self, state: State, status: Status) -> None:
        began = time.perf_counter()
        number = self._target(status)
        assert number is not None, "handle() is called for what wants() accepted"
        budget = PERIOD / status.speed - SEND_MARGIN
        self._evaluator.reset_account(deadline=time.monotonic() + budget)
        tick, start, memory = anchor_tick(number), state.state, status.memory
        previous = self._following(status)
        if previous is not None:
            start, memory = roll_forward(
                self._engine, self._actions, previous, state.tick, tick, start, memory
            )
        request = PlanRequest(number, tick, start, memory, previous)
        made = self._make(request, began, status.speed, self._fitted(budget))
        self._delay_s = 0.8 * self._delay_s + 0.2 * made.plan_ms * 1e-3
        self._publish(made, status.clock, state)

    def _following(self, status: Status) -> Plan | None:
        """The plan the robot will follow from now on: the newest that was sent to it."""
        sent = self._last.plan if self._last and self._last_clock == "realtime" else None
        if sent is not None and (status.tick - sent.tick) * TICK > sent.horizon:
            sent = None  # it has run out, or the robot has stopped since
        if sent is not None and (status.followed is None or sent.number > status.followed.number):
            return sent
        return status.followed

    def _target(self, status: Status) -> int | None:
        """Number of the plan to make from a realtime status, None if it is not time for one."""
        ahead = round(self._delay_s * status.speed / TICK) if self._options.compensate else 0
        tick = status.tick + ahead
        number = plan_due(tick)
        while number is None and self._options.compensate:
            tick += 1
            number = plan_due(tick)
        last = -1
        if self._last is not None and self._last_clock == "realtime":
            last = self._last.plan.number
        return number if number is not None and number > last else None

    def _fitted(self, budget: float) -> int | None:
        """Rollouts that the workers manage in the time there is [s]; None for all."""
        if not self._options.fit:
            return None
        rollouts = fitted(self._options.planner, self._evaluator.pace, budget * 1e3)
        fewer = rollouts < self._options.planner.rollouts
        if fewer != self._fewer:
            self._fewer = fewer
            most = self._options.planner.rollouts
            how = f"{rollouts} of {most}, as the workers manage" if fewer else f"all {most} again"
            self._tell("warning" if fewer else "info", f"rollouts per plan: {how}")
        return rollouts

    def _make(
        self,
        request: PlanRequest,
        began: float,
        speed: float = 0.0,
        rollouts: int | None = None,
    ) -> PlanReport:
        result = self._planner.plan(request, self._evaluator, rollouts)
        plan_ms = (time.perf_counter() - began) * 1e3
        return PlanReport.of(
            result,
            plan_ms=plan_ms,
            own_ms=plan_ms - self._evaluator.waited_s * 1e3,
            reissued=self._evaluator.reissued,
            workers=self._evaluator.workers,
            age_ticks=round(plan_ms * 1e-3 * speed / TICK),
        )

    def _publish(self, made: PlanReport, clock: str, state: State) -> None:
        self._last = PlanMessage.of(self._options.run, made)
        self._last_clock, self._last_state = clock, state.state
        self._bus.publish(self._last)
        if made.failed != self._failing:
            self._failing = made.failed
            how = "no usable rollouts, the last plan goes on" if made.failed else "plans are back"
            self._tell("warning", f"plan {made.plan.number}: {how}")
