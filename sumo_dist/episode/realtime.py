"""The asynchronous episode: the robot does not wait. Plans come when they come."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.command import Command, Operator, stopped
from sumo_dist.episode.ending import End, Ending, fault, unforeseen
from sumo_dist.episode.follow import Follower
from sumo_dist.episode.safety import StateWatch, getting_up, sitting_down
from sumo_dist.errors import SumoError
from sumo_dist.estimate.readings import Readings
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.timing import TICK

CALIBRATION_PLANS = 12
SLIP_S = 0.1  # wall time by which a tick may be late before the clock is set back
STATE_PATIENCE = 0.3  # share of a tick that the policy waits for its own tick's state
MEMORIES = 8  # ticks of which the policy's memory is kept: a state is no older when it is used


class Link(Protocol):
    """The rest of the system, as the robot sees it."""

    def send_readings(self, readings: Readings) -> None:
        """Publish what the sensors saw."""

    def send_question(self, request: PlanRequest, planner: PlannerConfig, speed: float) -> None:
        """Publish a plan's question, whether one is due or not; at speed 0 none is wanted."""

    def ask_plan(
        self, request: PlanRequest, planner: PlannerConfig, clock: Literal["calibrate"]
    ) -> PlanReport:
        """Wait for the plan of a state."""
        ...

    def newest_state(self, tick: int, patience: float) -> tuple[int, np.ndarray] | None:
        """Return tick and value of the newest state, waiting up to patience [s] for a tick's."""
        ...

    def new_plans(self) -> list[PlanReport]:
        """Return the plans that came since the last call."""
        ...


@dataclass(frozen=True)
class Pace:
    """How a realtime episode runs.

    Attributes:
        speed: robot time per wall time.
        resume_wait: wall time for which a robot that has stopped waits to be told to go on, before
            the episode ends [s].
    """

    speed: float
    resume_wait: float = 0.0


def calibrate(episode: Episode, state: np.ndarray, link: Link) -> float:
    """Return the speed at which the p90 plan fits its period, measured before the clock starts.

    Args:
        episode: to be planned for.
        state: (nq + nv,) at its start.
        link: to who plans.
    """
    took, memory = [], episode.controller.initial_memory()
    planner = episode.controls.planner
    for number in range(CALIBRATION_PLANS):
        request = episode.request(number, episode.body.tick, state, memory, None)
        began = time.monotonic()
        link.ask_plan(request, planner, "calibrate")
        took.append(time.monotonic() - began)
    # The first plans pay for compiling the task on the workers.
    return min(1.0, planner.period / float(np.percentile(took[CALIBRATION_PLANS // 3 :], 90)))


class RealtimeLoop:
    """One episode against the wall clock.

    Attributes:
        slipped_s: wall time by which the clock was set back because the robot came too late [s].
    """

    def __init__(
        self,
        episode: Episode,
        link: Link,
        operator: Operator,
        pace: Pace,
        stop: threading.Event,
        tell: Callable[[Literal["warning", "error"], str], None],
    ) -> None:
        """Join the parts.

        Args:
            episode: to run.
            link: the rest of the system.
            operator: gives commands.
            pace: of the clock.
            stop: ends the run.
            tell: speaks to people.
        """
        self._episode, self._link, self._operator = episode, link, operator
        self._pace, self._stop, self._tell = pace, stop, tell
        self._body, self._guard, self._controls = episode.body, episode.guard, episode.controls
        self._watch = StateWatch(episode.robot, episode.problem.model.nq)
        self._began = self._due = 0.0  # time.monotonic() of tick 0 and of the present one
        self._asked = -1  # tick of the newest state that a question was sent with
        self._stopping: Ending | None = None  # a stop that was commanded and not yet obeyed
        self._mode = "running"
        self.slipped_s = 0.0
        self._restart()

    def _restart(self) -> None:
        """Begin with no plan and a policy that was just started."""
        self._follower = Follower(self._episode.task.actions)
        self._memory = self._episode.controller.initial_memory()
        self._memories: deque[tuple[int, np.ndarray]] = deque(maxlen=MEMORIES)

    @property
    def mode(self) -> str:
        """One of "running", "paused", "stopping", "stopped" and "rising", for whoever watches."""
        paused = self._mode == "running" and self._controls.paused
        return "paused" if paused else self._mode

    def run(self) -> Ending:
        """Return how the episode ended."""
        self._began = time.monotonic() - self._body.tick * TICK / self._pace.speed
        standing = False
        while True:
            if not self._wait_for(self._body.tick):
                return Ending(End.INTERRUPTED)
            tick = self._body.tick
            newest = self._sense(tick)
            end = self._operated(tick)
            if end is not None and end.kind is not End.STOPPED:
                return end
            end = end or self._watch.trip(tick, newest)
            if end is None and newest is not None:
                self._episode.note_tick(newest[1], self._memory)
                verdict = self._episode.verdict(tick, newest[1])
                if verdict is not None:
                    return verdict
                self._take_plans()
                if self._follower.exhausted(tick) != standing:
                    standing = not standing
                    told = "the plan ran out: standing" if standing else "plans are back"
                    self._tell("warning", told)
                end = self._act(tick, newest[1])
            if end is not None and (final := self._stopped(end)) is not None:
                return final

    def _operated(self, tick: int) -> Ending | None:
        """Carry out commands; the time that the episode is paused does not count."""
        began = time.monotonic()
        end = self._controls.operate(self._operator, tick)
        if (held := time.monotonic() - began) > SLIP_S / 2:
            self._began += held
        return end

    def _take_plans(self) -> None:
        for report in self._link.new_plans():
            self._episode.recording.add_plan(report)
            self._follower.offer(report.plan)

    def _wait_for(self, tick: int) -> bool:
        """Sleep until a tick is due; False if told to stop."""
        self._due = self._began + tick * TICK / self._pace.speed
        late = time.monotonic() - self._due
        if late > SLIP_S:  # this process was held up: ticks in a burst would outrun its plans
            self._began, self._due = self._began + late, self._due + late
            self.slipped_s += late
        return not self._stop.wait(max(0.0, self._due - time.monotonic()))

    def _sense(self, tick: int) -> tuple[int, np.ndarray] | None:
        """Exchange readings for the newest state and its tick; ask for the plan of that state."""
        self._link.send_readings(self._body.read())
        self._memories.append((tick, self._memory))
        newest = self._link.newest_state(tick, STATE_PATIENCE * TICK / self._pace.speed)
        memory = dict(self._memories).get(-1 if newest is None else newest[0])
        if newest is not None and memory is not None and newest[0] > self._asked:
            self._asked, state = newest
            request = self._episode.request(-1, newest[0], state, memory, self._follower.plan)
            # a robot that has stopped needs no plans
            speed = self._pace.speed if self._mode == "running" else 0.0
            self._link.send_question(request, self._controls.planner, speed)
        return newest

    def _act(self, tick: int, state: np.ndarray) -> Ending | None:
        """Follow the plan for a tick; return why that was not possible."""
        action = self._follower.action(tick)
        targets, self._memory = self._episode.follow(action, state, self._memory)
        self._episode.recording.late_ms.append((time.monotonic() - self._due) * 1e3)
        finite = self._guard.send(targets)
        self._body.advance()
        return None if finite else fault("the policy's targets are not finite")

    def _stopped(self, end: Ending) -> Ending | None:
        """Sit down and stay so; return how the run ends, None once it stands as it was told to."""
        robot = self._episode.robot
        again: Ending | None = end
        while again is not None:
            end = again
            self._mode = "stopping"
            self._tell("error", f"{end.reason}: sitting down")
            self._move(sitting_down(robot, self._guard.last))
            self._mode = "stopped"
            if not self._told_to_rise():
                return end if end.kind is End.FELL else replace(end, sat_down=True)
            self._mode = "rising"
            self._tell("warning", "told to go on: getting up")
            again = self._move(getting_up(robot, self._guard.last), watched=True)
        self._link.new_plans()  # discard the plans that were made for before the stop
        self._restart()
        self._mode = "running"
        return None

    def _move(self, motion: Iterator[np.ndarray], watched: bool = False) -> Ending | None:
        """Send joint targets one a tick; return why the robot must stop, if that is watched."""
        for targets in motion:
            self._guard.send(targets)
            self._body.advance()
            tick = self._body.tick
            if not self._wait_for(tick):
                return Ending(End.INTERRUPTED)
            newest = self._sense(tick)
            self._episode.note_tick(None if newest is None else newest[1], self._memory)
            end = self._refuse_all_but_stop(tick) or self._watch.trip(tick, newest)
            if watched and end is not None:
                return end
        return None

    def _refuse_all_but_stop(self, tick: int) -> Ending | None:
        """Answer the commands that come while the robot sits down or gets up."""
        end = None
        for command in self._operator.take(tick, 0.0):
            if command.verb == "stop":
                self._operator.answer(command, tick, "")
                end = stopped(command)
            else:
                self._operator.answer(command, tick, f"the robot is {self._mode}")
        return end

    def _told_to_rise(self) -> bool:
        """Hold still until somebody says to go on and the state allows it."""
        deadline = time.monotonic() + self._pace.resume_wait
        while time.monotonic() < deadline and not self._stop.is_set():
            self._hold_still()
            for command in self._operator.take(self._body.tick, 0.0):
                refusal = self._refusal_to_rise(command)
                self._operator.answer(command, self._body.tick, refusal)
                if not refusal and command.verb == "stand":
                    return True
        return False

    def _hold_still(self) -> None:
        """Let a tick pass in which the servos hold what they were told last."""
        self._guard.send(self._guard.last)
        self._body.advance()
        if self._wait_for(self._body.tick):
            newest = self._sense(self._body.tick)
            self._episode.note_tick(None if newest is None else newest[1], self._memory)

    def _refusal_to_rise(self, command: Command) -> str:
        if command.verb == "stop":
            return ""  # it has
        if command.verb != "stand":
            return "the robot has stopped: let it stand first"
        tick = self._body.tick
        refusal = self._watch.may_rise(tick, self._link.newest_state(tick, 0.0))
        if refusal:
            self._tell("warning", f"cannot go on: {refusal}")
        return f"cannot go on: {refusal}" if refusal else ""


def guarded(loop: RealtimeLoop, episode: Episode) -> Ending:
    """Run a loop; whatever goes wrong in it makes the robot sit down, without any state."""
    try:
        return loop.run()
    except Exception as error:  # a robot must not be left as it walks
        end = unforeseen(error)
        try:
            for targets in sitting_down(episode.robot, episode.guard.last):
                episode.guard.send(targets)
                episode.body.advance()
        except SumoError:  # of the body itself: nothing moves it any more
            return end
        return replace(end, sat_down=True)
