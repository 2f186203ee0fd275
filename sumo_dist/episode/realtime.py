"""The asynchronous episode: the robot does not wait. Plans come when they come."""

import threading
import time
from collections.abc import Callable
from typing import Literal, Protocol

import numpy as np

from sumo_dist.episode.plant import Plant
from sumo_dist.episode.referee import Referee
from sumo_dist.estimate.readings import Readings
from sumo_dist.planner.follow import Follower
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.recording import Recording
from sumo_dist.rollout.interface import TICK, Controller
from sumo_dist.tasks.task import Task

PLAN_PERIOD = 0.05  # robot time between plans [s]
CALIBRATION_PLANS = 12
STATE_PATIENCE = 0.3  # share of a tick that the policy waits for its own tick's state
BLIND_TICKS = 5  # older than this, a state is no ground to stand on: the robot sits down
SIT_S = 0.7  # from the last joint targets to the sitting pose


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
    """One episode against the wall clock."""

    def __init__(
        self,
        plant: Plant,
        controller: Controller,
        task: Task,
        referee: Referee,
        link: Link,
        recording: Recording,
        speed: float,
        stop: threading.Event,
        tell: Callable[[Literal["warning", "error"], str], None],
    ) -> None:
        """Join the parts; `speed` is robot time per wall time."""
        self._plant, self._controller, self._task, self._referee = plant, controller, task, referee
        self._link, self._recording, self._speed = link, recording, speed
        self._stop, self._tell = stop, tell
        self._follower = Follower(task.actions)
        self._memory = controller.initial_memory()
        self._targets = np.array(task.scene.robot.stand)
        self._began = 0.0

    def run(self) -> str:
        """Return the referee's verdict, "interrupted", or the fault that made the robot sit."""
        self._began = time.monotonic()
        standing = False
        while True:
            tick = self._plant.tick
            if not self._wait_for(tick):
                return "interrupted"
            state = self._sense(tick)
            if state is None:
                return self._sit_down()
            self._recording.add_tick(self._plant.state, state, self._memory)
            verdict = self._referee.verdict(tick, self._plant.state)
            if verdict is not None:
                return verdict
            for report in self._link.new_plans():
                self._recording.add_plan(report)
                self._follower.offer(report.plan)
            if self._follower.exhausted(tick) != standing:
                standing = not standing
                self._tell(
                    "warning", "the plan ran out: standing" if standing else "plans are back"
                )
            self._act(tick, state)

    def _wait_for(self, tick: int) -> bool:
        """Sleep until a tick is due; False if told to stop."""
        due = self._began + tick * TICK / self._speed
        return not self._stop.wait(max(0.0, due - time.monotonic()))

    def _sense(self, tick: int) -> np.ndarray | None:
        """Exchange readings for a state; None if the newest is too old to act on."""
        self._link.send_readings(self._plant.read())
        self._link.send_status(
            tick, self._memory, self._follower.plan, "realtime", speed=self._speed
        )
        newest = self._link.newest_state(tick, STATE_PATIENCE * TICK / self._speed)
        if newest is None or tick - newest[0] > BLIND_TICKS:
            return None
        return newest[1]

    def _act(self, tick: int, state: np.ndarray) -> None:
        command = self._task.actions.commands(self._follower.action(tick))
        nq = self._plant.model.nq
        self._targets, self._memory = self._controller.step(
            state[:nq], state[nq:], command, self._memory
        )
        self._plant.step(self._targets)

    def _sit_down(self) -> str:
        """Ramp the joints to the sitting pose: without a state the policy cannot stand."""
        self._tell("error", "no state: sitting down")
        sit, start = np.array(self._task.scene.robot.sit), self._targets
        for step in range(round(2 * SIT_S / TICK)):
            self._plant.step(start + min(1.0, step * TICK / SIT_S) * (sit - start))
            self._recording.add_tick(self._plant.state, self._plant.state, self._memory)
            if not self._wait_for(self._plant.tick):
                break
        return f"fault: no state for {BLIND_TICKS * TICK:g} s, the robot sat down"
