"""The robot's side of the bus: readings and status out, states and plans in."""

import threading
import time
from collections.abc import Callable
from typing import Literal, TypeVar

import numpy as np

from sumo_dist.errors import Interrupted, Stopped, SumoError
from sumo_dist.estimate.readings import Readings
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.timing import anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.events import Tell
from sumo_dist.wire.messages import Order, PlanMessage, Sensors, State, Status

Clock = Literal["lockstep", "realtime", "calibrate"]

RESEND_S = 0.25  # a question without an answer is asked again this often
NOTICE_S = 3.0  # after this long the user is told what is being waited for

T = TypeVar("T")


class RobotLink:
    """Asks for states and plans. What is asked again gets the same answer (lockstep)."""

    def __init__(
        self,
        bus: Bus,
        run: str,
        wait: float,
        stop: threading.Event,
        tell: Tell,
        on_plan: Callable[[PlanReport], None],
        refuse: Callable[[Plan], str] = lambda _plan: "",
        state_size: int | None = None,
    ) -> None:
        """Subscribe.

        Args:
            bus: the robot's.
            run: its run.
            wait: how long a question waits for its answer [s].
            stop: ends the waiting.
            tell: speaks to people.
            on_plan: sees all plans that are taken.
            refuse: says why a plan cannot be followed, "" if it can; such a plan is dropped.
            state_size: nq + nv; a state of another size is dropped.
        """
        self._on_report, self._refuse = on_plan, refuse
        self._state_size, self._tick = state_size, 0
        self.refused = 0  # plans and states dropped
        self._ordered_stop = ""
        self._ordered_resume = False
        self._bus, self._run, self._wait, self._stop, self._tell = bus, run, wait, stop, tell
        self._arrived = threading.Condition()
        self._state: State | None = None
        self._plans: dict[int, PlanReport] = {}
        bus.subscribe(State, self._on_state)
        bus.subscribe(PlanMessage, self._on_plan)
        bus.subscribe(Order, self._on_order)

    def ask_state(self, readings: Readings) -> np.ndarray:
        """Return the estimated state (nq + nv,) of a tick (lockstep)."""

        def answer() -> np.ndarray | None:
            state = self._state
            return state.state if state is not None and state.tick == readings.tick else None

        return self._ask(lambda: self.send_readings(readings), answer, "a state")

    def ask_plan(
        self, readings: Readings, request: PlanRequest, clock: Clock = "lockstep"
    ) -> PlanReport:
        """Return the plan of a state.

        Asked again, the readings go along: the optimizer may have missed the state.
        """
        state_is_out = self._state is not None and self._state.tick == request.tick

        def publish() -> None:
            nonlocal state_is_out
            if not state_is_out:
                self.send_readings(readings)
            state_is_out = False
            self.send_status(
                request.tick, request.memory, request.previous, clock, wanted=request.number
            )

        return self._ask(publish, lambda: self._plans.get(request.number), "a plan")

    def send_readings(self, readings: Readings) -> None:
        """Publish what the sensors saw."""
        self._tick = readings.tick
        self._bus.publish(Sensors(self._run, **vars(readings)))

    def send_status(
        self,
        tick: int,
        memory: np.ndarray,
        followed: Plan | None,
        clock: Clock,
        wanted: int = -1,
        speed: float = 1.0,
    ) -> None:
        """Publish where the controller stands at a tick."""
        self._bus.publish(Status(self._run, tick, memory, wanted, clock, speed, followed))

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
        """
        with self._arrived:
            plans = [self._plans[number] for number in sorted(self._plans)]
            self._plans.clear()
        return [report for report in plans if report.plan.tick == anchor_tick(report.plan.number)]

    def stop_order(self) -> str | None:
        """Return who ordered the robot to stop and why, once for each order; None if nobody."""
        with self._arrived:
            order, self._ordered_stop = self._ordered_stop, ""
            return order or None

    def resume_order(self) -> bool:
        """Whether somebody said to go on since the last stop and the last call."""
        with self._arrived:
            order, self._ordered_resume = self._ordered_resume, False
            return order

    def _ask(self, publish: Callable[[], None], answer: Callable[[], T | None], what: str) -> T:
        began, noticed = time.monotonic(), False
        while True:
            publish()
            with self._arrived:
                self._arrived.wait_for(
                    lambda: bool(self._ordered_stop) or answer() is not None, RESEND_S
                )
                if self._ordered_stop:
                    raise Stopped(self._ordered_stop)
                result = answer()
                if result is not None:
                    self._plans.clear()
                    return result
            waited = time.monotonic() - began
            if self._stop.is_set():
                raise Interrupted("told to stop")
            if waited > self._wait:
                raise SumoError(f"no answer to the request for {what} in {self._wait:g} s")
            if waited > NOTICE_S and not noticed:
                noticed = True
                self._tell("warning", f"waiting for {what}")

    def _refused(self, what: str) -> None:
        self.refused += 1
        if self.refused == 1:
            self._tell("error", f"{what}; from now on only counted")

    def _on_state(self, state: State) -> None:
        """Take a state; one from the future would stand in the way of all that follow."""
        if state.tick > self._tick or self._state_size not in (None, len(state.state)):
            size = len(state.state)
            self._refused(f"a state of tick {state.tick} with {size} numbers is refused")
            return
        with self._arrived:
            if self._state is None or state.tick >= self._state.tick:
                self._state = state
                self._arrived.notify_all()

    def _on_plan(self, message: PlanMessage) -> None:
        report = message.report
        if reason := self._refuse(report.plan):
            self._refused(f"plan {report.plan.number} is refused: {reason}")
            return
        with self._arrived:
            self._plans[report.plan.number] = report
            self._arrived.notify_all()
        self._on_report(report)

    def _on_order(self, order: Order) -> None:
        with self._arrived:
            if order.action == "stop":
                by = f"{order.source}: {order.reason}" if order.reason else order.source
                self._ordered_stop, self._ordered_resume = f"stopped by {by}", False
            else:
                self._ordered_resume = True
            self._arrived.notify_all()
