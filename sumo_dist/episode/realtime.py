"""The asynchronous episode: the robot does not wait. Plans come when they come."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Literal, Protocol

import numpy as np

from sumo_dist.episode.follow import Follower
from sumo_dist.episode.referee import Referee
from sumo_dist.episode.safety import StateWatch, getting_up, sitting_down
from sumo_dist.estimate.readings import Readings
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.plant.simulated import Plant
from sumo_dist.record.recording import Recording
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.robots.robot import Robot
from sumo_dist.rollout.interface import Controller
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK

PLAN_PERIOD = 0.05  # robot time between plans [s]
CALIBRATION_PLANS = 12
SLIP_S = 0.1  # wall time by which a tick may be late before the clock is set back
STATE_PATIENCE = 0.3  # share of a tick that the policy waits for its own tick's state


class Link(Protocol):
    """The rest of the system, as the robot sees it."""

    def send_readings(self, readings: Readings) -> None:
        """Publish what the sensors saw."""

    def send_status(
        self,
        tick: int,
        memory: np.ndarray,
        followed: Plan | None,
        clock: Literal["realtime"],
        *,
        speed: float,
    ) -> None:
        """Publish where the controller stands."""

    def ask_plan(
        self, readings: Readings, request: PlanRequest, clock: Literal["calibrate"]
    ) -> PlanReport:
        """Wait for the plan of a state."""
        ...

    def newest_state(self, tick: int, patience: float) -> tuple[int, np.ndarray] | None:
        """Return tick and value of the newest state, waiting up to patience [s] for a tick's."""
        ...

    def new_plans(self) -> list[PlanReport]:
        """Return the plans that came since the last call."""
        ...

    def stop_order(self) -> str | None:
        """Return who ordered the robot to stop and why, once for each order; None if nobody."""
        ...

    def resume_order(self) -> bool:
        """Whether somebody said to go on since the last stop and the last call."""
        ...


def calibrate(plant: Plant, memory: np.ndarray, link: Link) -> float:
    """Return the speed at which the p90 plan fits its period, measured before the clock starts."""
    took = []
    for number in range(CALIBRATION_PLANS):
        request = PlanRequest(number, plant.tick, plant.state, memory, None)
        began = time.monotonic()
        link.ask_plan(plant.read(), request, "calibrate")
        took.append(time.monotonic() - began)
    # The first plans pay for compiling the task on the workers.
    return min(1.0, PLAN_PERIOD / float(np.percentile(took[CALIBRATION_PLANS // 3 :], 90)))


class RealtimeLoop:
    """One episode against the wall clock.

    Attributes:
        mode: "running", "stopping", "stopped" or "rising", for whoever watches.
        slipped_s: wall time by which the clock was set back because the robot came too late [s].
    """

    def __init__(
        self,
        plant: Plant,
        guard: CommandGuard,
        controller: Controller,
        task: Task,
        referee: Referee,
        link: Link,
        recording: Recording,
        speed: float,
        stop: threading.Event,
        tell: Callable[[Literal["warning", "error"], str], None],
        resume_wait: float = 0.0,
    ) -> None:
        """Join the parts.

        Args:
            plant: the robot.
            guard: the way of commands to it.
            controller: its policy.
            task: what it does.
            referee: ends the run.
            link: the rest of the system.
            recording: is written.
            speed: robot time per wall time.
            stop: ends the run.
            tell: speaks to people.
            resume_wait: wall time for which a robot that has stopped waits to be told to go on,
                before the run ends [s].
        """
        self._plant, self._guard, self._controller = plant, guard, controller
        self._task, self._referee, self._link = task, referee, link
        self._recording, self._speed, self._resume_wait = recording, speed, resume_wait
        self._stop, self._tell = stop, tell
        self._follower = Follower(task.actions)
        self._memory = controller.initial_memory()
        self._watch = StateWatch(task.scene.robot, plant.model.nq)
        self._began = self._due = 0.0  # time.monotonic() of tick 0 and of the present one
        self.mode = "running"
        self.slipped_s = 0.0

    def run(self) -> str:
        """Return the referee's verdict, "interrupted", or what made the robot stop."""
        self._began = time.monotonic()
        standing = False
        while True:
            tick = self._plant.tick
            if not self._wait_for(tick):
                return "interrupted"
            newest = self._sense(tick)
            reason = self._link.stop_order() or self._watch.trip(tick, newest)
            if reason is None and newest is not None:
                self._recording.add_tick(self._plant.state, newest[1], self._memory)
                verdict = self._referee.verdict(tick, self._plant.state)
                if verdict is not None:
                    return verdict
                self._take_plans()
                if self._follower.exhausted(tick) != standing:
                    standing = not standing
                    told = "the plan ran out: standing" if standing else "plans are back"
                    self._tell("warning", told)
                reason = self._act(tick, newest[1])
            if reason is not None and (end := self._stopped(reason)) is not None:
                return end

    def _take_plans(self) -> None:
        for report in self._link.new_plans():
            self._recording.add_plan(report)
            self._follower.offer(report.plan)

    def _wait_for(self, tick: int) -> bool:
        """Sleep until a tick is due; False if told to stop."""
        self._due = self._began + tick * TICK / self._speed
        late = time.monotonic() - self._due
        if late > SLIP_S:  # this process was held up: ticks in a burst would outrun its plans
            self._began, self._due = self._began + late, self._due + late
            self.slipped_s += late
        return not self._stop.wait(max(0.0, self._due - time.monotonic()))

    def _sense(self, tick: int) -> tuple[int, np.ndarray] | None:
        """Exchange readings for the newest state and its tick."""
        self._link.send_readings(self._plant.read())
        running = self.mode == "running"
        self._link.send_status(
            *(tick, self._memory, self._follower.plan, "realtime"),
            speed=self._speed if running else 0.0,  # a robot that has stopped needs no plans
        )
        return self._link.newest_state(tick, STATE_PATIENCE * TICK / self._speed)

    def _act(self, tick: int, state: np.ndarray) -> str | None:
        """Follow the plan for a tick; return why that was not possible."""
        command = self._task.actions.commands(self._follower.action(tick))
        nq = self._plant.model.nq
        targets, self._memory = self._controller.step(state[:nq], state[nq:], command, self._memory)
        self._recording.late_ms.append((time.monotonic() - self._due) * 1e3)
        return None if self._guard.send(targets) else "fault: the policy's targets are not finite"

    def _stopped(self, reason: str) -> str | None:
        """Sit down and stay so; return how the run ends, None once it stands as it was told to."""
        robot: Robot = self._task.scene.robot
        again: str | None = reason
        while again is not None:
            reason = again
            self.mode = "stopping"
            self._tell("error", f"{reason}: sitting down")
            self._move(sitting_down(robot, self._guard.last))
            self._link.resume_order()  # one of before says nothing about this stop
            self.mode = "stopped"
            if not self._told_to_rise():
                return reason if reason == "fell" else f"{reason}, the robot sat down"
            self.mode = "rising"
            self._tell("warning", "told to go on: getting up")
            again = self._move(getting_up(robot, self._guard.last), watched=True)
        self._link.new_plans()  # of before
        self._follower = Follower(self._task.actions)
        self._memory = self._controller.initial_memory()
        self.mode = "running"
        return None

    def _move(self, motion: Iterator[np.ndarray], watched: bool = False) -> str | None:
        """Send joint targets one a tick; return why the robot must stop, if that is watched."""
        for targets in motion:
            self._guard.send(targets)
            self._recording.add_tick(self._plant.state, self._plant.state, self._memory)
            tick = self._plant.tick
            if not self._wait_for(tick):
                return "interrupted"
            newest = self._sense(tick)
            reason = self._link.stop_order() or self._watch.trip(tick, newest)
            if watched and reason is not None:
                return reason
        return None

    def _told_to_rise(self) -> bool:
        """Hold still until somebody says to go on and the state allows it."""
        deadline, said = time.monotonic() + self._resume_wait, ""
        while time.monotonic() < deadline and not self._stop.is_set():
            self._move(iter([self._guard.last]))
            if self._link.resume_order():
                tick = self._plant.tick
                refusal = self._watch.may_rise(tick, self._link.newest_state(tick, 0.0))
                if not refusal:
                    return True
                if refusal != said:  # orders are repeated
                    self._tell("warning", f"cannot go on: {refusal}")
                said = refusal
        return False
