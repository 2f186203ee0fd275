"""Makes the plans: shift, sample, send knots to workers, gather costs, update, publish.

It is started for no task: it takes up the episode that the robot is in. It keeps no plan that the
robot does not have: everything a plan depends on comes with its question, so an optimizer that is
restarted goes on where the last one ended.
"""

import threading
import time
from collections import deque
from collections.abc import Collection
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from sumo_dist.costs.table import CostSettings
from sumo_dist.dispatch.evaluator import RemoteEvaluator
from sumo_dist.dispatch.fit import fitted, periods
from sumo_dist.dispatch.pace import Pace
from sumo_dist.dispatch.questions import QuestionSlot
from sumo_dist.dispatch.roundtrip import RoundTrip
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.follow import unfollowable
from sumo_dist.errors import Interrupted, PolicyError, SumoError, TaskError
from sumo_dist.planner.compensate import roll_forward
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.guidance import make_guide
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import Planner, PlanRequest
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.planner.report import PlanReport
from sumo_dist.rollout import engine_identity
from sumo_dist.rollout.base import HUGE
from sumo_dist.rollout.interface import Engine
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK, anchor_tick, plan_due
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.connection import Connection
from sumo_dist.wire.events import Tell, teller
from sumo_dist.wire.health import Counters, Heartbeat
from sumo_dist.wire.keys import checked_priority, unique_name
from sumo_dist.wire.messages import EpisodeInfo, NoPlan, PlanMessage, Question

SEND_MARGIN = 0.004  # wall time kept for the update [s]
SENT = 32  # plans that may be on their way to the robot, and wait there until they are due


@dataclass(frozen=True, kw_only=True)
class OptimizerOptions(Connection):
    """An optimizer.

    Attributes:
        connect: the router's endpoint.
        keys: folder from `sumo-dist keys host`, for an endpoint with TLS.
        robot: whose plans to make.
        engine: kind of rollout engine that workers must have, see rollout.make_engine.
        compensate: in realtime, plan from where the robot will be when the plan arrives.
        fit: in realtime, make fewer rollouts when the workers cannot do all of them in time.
        priority: of the robot among those that its workers serve, from -9 to 9: they work for a
            lower one when no higher one asks. Realtime goes before lockstep whatever it is.
    """

    role: ClassVar[str] = "optimizer"

    engine: str = "auto"
    compensate: bool = True
    fit: bool = True
    priority: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_priority(self.priority)


def run(options: OptimizerOptions, stop: threading.Event) -> None:
    """Serve until told to stop."""
    _, build = engine_identity(options.engine)
    with options.dial() as bus, ExitStack() as stack:
        name, tell = unique_name(), teller(bus, "optimizer")
        evaluator = RemoteEvaluator(bus, name, build, stop, tell, options.priority)
        inbox = QuestionSlot(bus)
        service = stack.enter_context(OptimizerServer(options, bus, evaluator, tell))
        more = partial(evaluator.workers.publish_health, bus, name)
        stack.enter_context(Heartbeat(bus, "optimizer", service.health, more))
        bus.announce("optimizer", name, build)
        while not stop.is_set():
            info, question = inbox.wait(timeout=0.1)
            try:
                if info is not None:
                    service.enter(info)
                if question is not None:
                    service.handle(question, inbox.arrived)
            except Interrupted:
                return
            except (TaskError, PolicyError) as error:
                service.give_up(str(error))
            except SumoError as error:  # of a question that makes no sense, not of this service
                service.refuse(str(error))


class OptimizerServer:
    """Answers questions with plans, one at a time, for both clocks; a context manager."""

    def __init__(
        self, options: OptimizerOptions, bus: Bus, evaluator: RemoteEvaluator, tell: Tell
    ) -> None:
        """Start with no episode."""
        self._tell = tell
        self._options, self._bus, self._evaluator = options, bus, evaluator
        self._info: EpisodeInfo | None = None
        self._seed = 0
        self._problem: Problem | None = None
        self._engine: Engine | None = None  # of this process, see `_here`
        self._planner: Planner | None = None
        self._refused = 0  # questions and episodes that made no sense
        self._delay_s = 0.0  # smoothed wall time that a plan takes
        self._forget()

    def _forget(self) -> None:
        """Forget the plans of an episode."""
        self._complained = False  # of a question that makes no sense
        self._last: PlanMessage | None = None
        self._last_clock, self._last_state = "", np.empty(0)  # what the last plan was made for
        self._way = RoundTrip()  # from here to the robot and back
        self._sent: deque[Plan] = deque(maxlen=SENT)  # in realtime
        self._failing = False
        self._no_plan = ""  # why there will be none
        self._fewer = False  # rollouts than configured

    def __enter__(self) -> "OptimizerServer":
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def enter(self, info: EpisodeInfo) -> None:
        """Take up the robot's episode, unless it is the one at hand.

        Raises:
            SumoError: its task is not here, or is another one here.
        """
        if self._info is not None and self._info.run == info.run:
            return
        self._info, self._bus.run = info, info.run
        self._forget()
        self._evaluator.workers.forgive()
        self._problem = self._planner = None
        config = EpisodeConfig.from_json(info.config)
        problem = Problem.build(load_task(config.task), planning_options(config.planner))
        if problem.hash != info.task_hash:
            raise SumoError(
                f"its {config.task} has hash {problem.hash}, the robot's has {info.task_hash}: "
                "the task's files differ between the hosts"
            )
        self._problem, self._seed = problem, config.seed
        self._close()

    def refuse(self, reason: str) -> None:
        """Take note of what cannot be answered."""
        self._refused += 1
        if not self._complained:
            self._complained = True
            self._tell("error", f"a plan that cannot be made: {reason}; from now on only counted")

    def give_up(self, reason: str) -> None:
        """Tell the robot that there will be no plan, now and whenever it asks again."""
        self._no_plan = reason
        self._bus.publish(NoPlan(self._bus.run or "", reason))

    def health(self) -> tuple[str, Counters]:
        """How it is, for whoever watches."""
        last = self._last
        counters: dict[str, int | float | str] = {
            "workers": len(self._evaluator.workers),
            "refused": self._refused,
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

    def handle(self, question: Question, arrived: float) -> None:
        """Make and publish the plan that is asked for, or repeat the one that was missed.

        Args:
            question: what a plan depends on.
            arrived: time.monotonic() at which it came.

        Raises:
            SumoError: state, memory, plan, weights or settings are not of this robot's episode.
            TaskError: the task's own code raises.
            PolicyError: the settings name a learned policy that this host cannot use.
        """
        if question.run != self._bus.run:
            return  # of an episode that is over
        if self._no_plan:
            self.give_up(self._no_plan)
            return
        if self._problem is None:
            return  # of an episode that cannot be taken up
        settings = PlannerConfig.from_settings(question.settings)
        self._check(self._problem, question, settings.rate)
        planner = self._turn_to(settings)
        if question.clock == "realtime":
            self._way.heard(question.heard, question.held_ms * 1e-3, arrived)
            number = self._target(question, arrived, settings.rate)
            if number is not None:
                self._plan_realtime(planner, question, number, arrived)
        elif self._is_repeated(question):
            assert self._last is not None, "else nothing is repeated"
            self._bus.publish(self._last)
        elif question.number >= 0:
            self._plan_lockstep(planner, question)

    def _check(self, problem: Problem, question: Question, rate: int) -> None:
        """Refuse what every worker would refuse: all of them would be left out for it."""
        state, memory = question.state, question.memory
        sizes = len(state), len(memory)
        model, contract = problem.model, problem.policy.contract
        wanted = model.nq + model.nv, contract.memory_size
        if sizes != wanted:
            raise SumoError(f"state and memory have {sizes} numbers, this robot's have {wanted}")
        if not all(np.all(np.abs(numbers) <= HUGE) for numbers in (state, memory)):
            raise SumoError(f"state or memory is beyond {HUGE:g}")
        followed, actions = question.followed, problem.task.actions
        if followed is not None and (wrong := unfollowable(followed, actions, rate)):
            raise SumoError(f"the followed plan is none of this robot: {wrong}")

    def _is_repeated(self, question: Question) -> bool:
        return (
            self._last is not None
            and (self._last_clock, self._last.plan.number) == (question.clock, question.number)
            and np.array_equal(self._last_state, question.state)
        )

    def _turn_to(self, settings: PlannerConfig) -> Planner:
        """Return the planner of some settings; only another model needs another problem."""
        assert self._problem is not None, "handle() has seen to it"
        if self._planner is None or self._planner.config != settings:
            options = planning_options(settings)
            if self._planner is not None and options != planning_options(self._planner.config):
                self._problem = Problem.build(self._problem.task, options)
                self._close()
            guide = make_guide(self._problem, settings)
            self._planner = Planner(settings, self._problem.task.actions, self._seed, guide)
        return self._planner

    def _close(self) -> None:
        if self._engine is not None:
            self._engine.close()
        self._engine = None

    def _cost(self, question: Question) -> CostSettings:
        assert self._problem is not None, "handle() has seen to it"
        table = self._problem.task.table
        return table.check(CostSettings(question.weights, question.parameters))

    def _plan_lockstep(self, planner: Planner, question: Question) -> None:
        began = time.perf_counter()
        request = PlanRequest(
            question.number,
            question.tick,
            question.state,
            question.memory,
            question.followed,
            self._cost(question),
        )
        self._publish(self._make(planner, request, began), question)

    def _plan_realtime(
        self, planner: Planner, question: Question, number: int, arrived: float
    ) -> None:
        began, now = time.perf_counter(), time.monotonic()
        config, paces = planner.config, self._evaluator.workers.asked().values()
        period = config.period / question.speed
        budget = periods(paces, period * 1e3, SEND_MARGIN * 1e3) * period - SEND_MARGIN
        tick, start, memory = anchor_tick(number, config.rate), question.state, question.memory
        plans = self._followed(question)
        if plans:
            assert self._problem is not None, "handle() has seen to it"
            start, memory = roll_forward(
                *(self._here(), self._problem.task.actions, plans),
                *(question.tick, tick, start, memory),
            )
        previous = plans[-1] if plans else None
        request = PlanRequest(number, tick, start, memory, previous, self._cost(question))
        rollouts = self._fitted(config, paces, budget)
        made = self._make(planner, request, began, rollouts, now + budget)
        took = made.plan_ms * 1e-3
        new = (
            0.5 if took > self._delay_s else 0.2
        )  # a plan too far ahead harms less than a late one
        self._delay_s += new * (took - self._delay_s)
        age = now - arrived + made.plan_ms * 1e-3 + self._way.seconds
        self._publish(replace(made, age_ticks=round(age * question.speed / TICK)), question)
        self._sent.append(made.plan)
        self._way.sent(number, time.monotonic())

    def _followed(self, question: Question) -> list[Plan]:
        """Plans that the robot will follow from now on, in turn: its own, and those sent since."""
        followed = question.followed
        own = -1 if followed is None else followed.number
        sent = [  # but for those that have run out: the robot has stopped since
            plan
            for plan in self._sent
            if plan.number > own and (question.tick - plan.tick) * TICK <= plan.horizon
        ]
        return sent if followed is None else [followed, *sent]

    def _target(self, question: Question, arrived: float, rate: int) -> int | None:
        """Number of the plan to make from a realtime question, None if it is not time for one.

        It is the first one that is due when the robot will have it.
        """
        if question.speed <= 0:
            return None
        tick = question.tick
        if self._options.compensate:
            waits = time.monotonic() - arrived + self._delay_s + self._way.seconds
            tick += round(waits * question.speed / TICK)
        number = plan_due(tick, rate)
        while number is None and self._options.compensate:
            tick += 1
            number = plan_due(tick, rate)
        last = -1
        if self._last is not None and self._last_clock == "realtime":
            last = self._last.plan.number
        return number if number is not None and number > last else None

    def _fitted(
        self, settings: PlannerConfig, paces: Collection[Pace], budget: float
    ) -> int | None:
        """Rollouts that the workers manage in the time there is [s]; None for all."""
        if not self._options.fit:
            return None
        rollouts, most = fitted(settings, paces, budget * 1e3), settings.rollouts
        if (rollouts < most) != self._fewer:
            self._fewer = rollouts < most
            how = (
                f"{rollouts} of {most}, as the workers manage"
                if self._fewer
                else f"all {most} again"
            )
            self._tell("warning" if self._fewer else "info", f"rollouts per plan: {how}")
        return rollouts

    def _make(
        self,
        planner: Planner,
        request: PlanRequest,
        began: float,
        rollouts: int | None = None,
        deadline: float | None = None,
    ) -> PlanReport:
        assert self._problem is not None, "handle() has seen to it"
        self._evaluator.begin(self._problem, planner.config, deadline)
        result = planner.plan(request, self._evaluator, rollouts)
        if result.failed and result.evaluation.answered.any():
            self._blame(planner, request)
        plan_ms = (time.perf_counter() - began) * 1e3
        return PlanReport.of(
            result,
            plan_ms=plan_ms,
            own_ms=plan_ms - self._evaluator.waited_s * 1e3,
            reissued=self._evaluator.reissued,
            workers=len(self._evaluator.workers),
        )

    def _blame(self, planner: Planner, request: PlanRequest) -> None:
        """Look for the reason here: workers do not say which of the terms is not finite."""
        assert self._problem is not None, "handle() has seen to it"
        evaluator = Evaluator(self._problem, self._here(), planner.config)
        start = request.state, request.memory, request.cost.parameters
        evaluator.blame(*start, planner.shifted(request)[None])

    def _here(self) -> Engine:
        """Return an engine in this process, for single rollouts."""
        assert self._problem is not None, "handle() has seen to it"
        if self._engine is None:
            self._engine = self._problem.engine(1, self._options.engine)
        return self._engine

    def _publish(self, made: PlanReport, question: Question) -> None:
        self._last = PlanMessage.of(question.run, made)
        self._last_clock, self._last_state = question.clock, question.state
        self._bus.publish(self._last)
        if made.failed != self._failing:
            self._failing = made.failed
            how = "no usable rollouts, the last plan goes on" if made.failed else "plans are back"
            self._tell("warning", f"plan {made.plan.number}: {how}")
