"""The robot's side of the bus: the episode, readings and questions out, states and plans in."""

import threading
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Literal, TypeVar

import numpy as np

from sumo_dist.dispatch.operator import BusOperator
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.follow import misfit
from sumo_dist.errors import Interrupted, Stopped, SumoError, TaskError
from sumo_dist.estimate.readings import Readings
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.timing import anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.events import Tell
from sumo_dist.wire.keys import OPERATOR, Member
from sumo_dist.wire.messages import (
    EpisodeEnd,
    EpisodeInfo,
    NoPlan,
    PlanMessage,
    Question,
    Sensors,
    State,
)

Clock = Literal["lockstep", "realtime", "calibrate"]

RESEND_S = 0.25  # a question without an answer is asked again this often
NOTICE_S = 3.0  # after this long the user is told what is being waited for
QUIET_S = 30.0  # and not again for this long

T = TypeVar("T")


class RobotLink:
    """Asks for states and plans. What is asked again gets the same answer (lockstep).

    Attributes:
        operator: gives commands.
        refused: states, plans and episodes that do not fit the robot, dropped so far.
    """

    def __init__(
        self,
        bus: Bus,
        wait: float,
        stop: threading.Event,
        tell: Tell,
        on_plan: Callable[[PlanReport], None],
    ) -> None:
        """Subscribe.

        Args:
            bus: the robot's; its run is that of the episode.
            wait: how long a question waits for its answer [s].
            stop: ends the waiting.
            tell: speaks to people.
            on_plan: sees all plans that are taken.
        """
        self._bus, self._wait, self._stop, self._tell = bus, wait, stop, tell
        self._on_report = on_plan
        self._arrived = threading.Condition()
        self.refused = 0
        self._misled = False  # the others may be: somebody has told of another episode
        self._noticed: dict[str, float] = {}  # when the user was told of a wait, by what for
        self._own: set[str] = set()  # runs of the episodes so far: an echo of one is no lie
        self._begin(None, None)
        self.operator = BusOperator(bus, stop, self._wake)
        bus.subscribe(State, self._on_state)
        bus.subscribe(PlanMessage, self._on_plan)
        bus.subscribe(NoPlan, self._on_no_plan)
        bus.subscribe(EpisodeInfo, self._on_info)
        bus.watch(on_change=self._on_member)

    def enter(self, episode: Episode, info: EpisodeInfo) -> None:
        """Take up an episode: from now on all that is said is of it, and others are told."""
        self._own.add(info.run)
        self._begin(episode, info)
        self._bus.run = info.run
        self.announce()

    def _begin(self, episode: Episode | None, info: EpisodeInfo | None) -> None:
        with self._arrived:
            self._episode, self._info = episode, info
            self._tick = 0
            self._state: State | None = None
            self._plans: dict[int, PlanReport] = {}
            self._heard = -1, 0.0  # newest plan that came in realtime, and when [s]
            self._no_plan = ""  # why none will come
            self._asked: Question | None = None  # the newest question

    def announce(self) -> None:
        """Say which episode it is."""
        if self._info is not None:
            self._bus.publish(self._info)

    def _on_member(self, member: Member, alive: bool) -> None:
        """Tell whoever joins of the episode, and an operator what it is like.

        While the robot is paused, nothing else would be said. In lockstep what is asked again gets
        the same answer; in realtime no plan is wanted.
        """
        if not alive:
            return
        self.announce()
        asked = self._asked
        if member.role == OPERATOR and asked is not None:
            lockstep = asked.clock == "lockstep"
            self._bus.publish(asked if lockstep else replace(asked, speed=0.0))

    def end(self, tick: int, reason: str, success: bool, last: bool) -> None:
        """Say that the episode is over; messages may be dropped, and nobody answers this one."""
        for _ in range(3):
            self._bus.publish(EpisodeEnd(self._bus.run or "", tick, reason, success, last))
            time.sleep(0.02)

    def ask_state(self, readings: Readings) -> np.ndarray:
        """Return the estimated state (nq + nv,) of a tick (lockstep)."""

        def answer() -> np.ndarray | None:
            state = self._state
            return state.state if state is not None and state.tick == readings.tick else None

        return self._ask(lambda: self.send_readings(readings), answer, "a state")

    def ask_plan(
        self, request: PlanRequest, planner: PlannerConfig, clock: Clock = "lockstep"
    ) -> PlanReport:
        """Return the plan of a state."""
        self._tick = request.tick
        self._asked = question = self._question(request, planner, clock, 1.0)
        return self._ask(
            lambda: self._bus.publish(question), lambda: self._plans.get(request.number), "a plan"
        )

    def send_readings(self, readings: Readings) -> None:
        """Publish what the sensors saw."""
        if self._misled:
            self._misled = False
            self.announce()
        self._tick = readings.tick
        self._bus.publish(Sensors(self._bus.run or "", **vars(readings)))

    def send_question(self, request: PlanRequest, planner: PlannerConfig, speed: float) -> None:
        """Publish a plan's question (realtime), unless it asks of a state that makes no sense."""
        if np.isfinite(request.state).all():
            self._asked = self._question(request, planner, "realtime", speed)
            self._bus.publish(self._asked)

    def _question(
        self, request: PlanRequest, planner: PlannerConfig, clock: Clock, speed: float
    ) -> Question:
        heard, at = self._heard if clock == "realtime" else (-1, 0.0)
        return Question(
            self._bus.run or "",
            number=request.number,
            tick=request.tick,
            clock=clock,
            speed=speed,
            state=request.state,
            memory=request.memory,
            followed=request.previous,
            weights=request.cost.weights,
            parameters=request.cost.parameters,
            settings=asdict(planner),
            heard=heard,
            held_ms=(time.monotonic() - at) * 1e3 if heard >= 0 else 0.0,
        )

    def newest_state(self, tick: int, patience: float) -> tuple[int, np.ndarray] | None:
        """Return tick and value of the newest state, waiting up to patience [s] for a tick's."""

        def current() -> bool:
            return self._state is not None and self._state.tick >= tick

        with self._arrived:
            self._arrived.wait_for(current, patience)
            return None if self._state is None else (self._state.tick, self._state.state)

    def new_plans(self) -> list[PlanReport]:
        """Return the plans that came since the last call, oldest first.

        Late answers to the calibration are left out: its plans are all of tick 0.

        Raises:
            TaskError: none will come, because the task's own code raises.
        """
        with self._arrived:
            self._check_plans_come()
            episode, plans = self._episode, [self._plans[number] for number in sorted(self._plans)]
            self._plans.clear()
        return [report for report in plans if episode and _is_anchored(report, episode)]

    def _ask(self, publish: Callable[[], None], answer: Callable[[], T | None], what: str) -> T:
        began, again = time.monotonic(), False
        while not self._stop.is_set():  # also where every answer comes at once
            if again:
                self.announce()  # it may be the episode that the others have missed
            publish()
            again = True
            with self._arrived:
                self._arrived.wait_for(
                    lambda: self.operator.stop_waits() or self._no_plan or answer() is not None,
                    RESEND_S,
                )
                if self.operator.stop_waits():
                    raise Stopped(f"while waiting for {what}")
                self._check_plans_come()
                result = answer()
                if result is not None:
                    self._plans.clear()
                    return result
            now = time.monotonic()
            waited = now - began
            if waited > self._wait:
                raise SumoError(f"no answer to the request for {what} in {self._wait:g} s")
            if waited > NOTICE_S and now > self._noticed.get(what, -QUIET_S) + QUIET_S:
                self._noticed[what] = now
                self._tell("warning", f"waiting for {what}")
        raise Interrupted("told to stop")

    def _wake(self) -> None:
        with self._arrived:
            self._arrived.notify_all()

    def _refused(self, what: str) -> None:
        self.refused += 1
        if self.refused == 1:
            self._tell("error", f"{what}; from now on only counted")

    def _on_info(self, info: EpisodeInfo) -> None:
        """Put right what somebody else tells of this robot, with the next readings."""
        if self._info is not None and info.run != self._info.run:
            self._misled = True
            if info.run not in self._own:
                self._refused(f"an episode {info.run!r} that is not this robot's is refused")

    def _on_state(self, state: State) -> None:
        """Take a state; one from the future would stand in the way of all that follow."""
        episode = self._episode
        if episode is None:
            return
        model, size = episode.problem.model, len(state.state)
        if state.tick > self._tick or size != model.nq + model.nv:
            self._refused(f"a state of tick {state.tick} with {size} numbers is refused")
            return
        with self._arrived:
            if self._state is None or state.tick >= self._state.tick:
                self._state = state
                self._arrived.notify_all()

    def _check_plans_come(self) -> None:
        if self._no_plan:
            raise TaskError(self._no_plan)

    def _on_no_plan(self, message: NoPlan) -> None:
        with self._arrived:
            self._no_plan = message.reason
            self._arrived.notify_all()

    def _on_plan(self, message: PlanMessage) -> None:
        episode, report, number = self._episode, message.report, message.plan.number
        if episode is None:
            return
        if reason := misfit(report, episode.task, episode.controls.planner, self._tick):
            self._refused(f"plan {number} is refused: {reason}")
            return
        with self._arrived:
            self._plans[number] = report
            if number > self._heard[0] and _is_anchored(report, episode):
                self._heard = number, time.monotonic()
            self._arrived.notify_all()
        self._on_report(report)


def _is_anchored(report: PlanReport, episode: Episode) -> bool:
    """Whether a plan begins on the tick that its number says, at the episode's rate."""
    return report.plan.tick == anchor_tick(report.plan.number, episode.controls.planner.rate)
