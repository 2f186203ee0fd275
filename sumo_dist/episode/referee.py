"""Judges an episode, tick by tick: solved, fallen, out of time, or going on."""

from collections.abc import Iterator

import mujoco
import numpy as np

from sumo_dist.costs.blame import truths_of
from sumo_dist.costs.view import View, ViewLayout
from sumo_dist.episode.ending import End, Ending
from sumo_dist.tasks.task import Task
from sumo_dist.tasks.terms import Predicate, lies
from sumo_dist.timing import TICK

FALL_S = 1.0  # a robot that is down for this long fell; before, it may still come up


class Referee:
    """Watches one episode; ask it once per tick.

    Attributes:
        parameters: (n,) of the task, which its success test reads.
    """

    def __init__(self, task: Task, model: mujoco.MjModel, time_limit: float | None = None) -> None:
        """Judge a task on a model of its scene; time_limit overrides the task's [s]."""
        self._task = task
        self._data = mujoco.MjData(model)
        self._model = model
        self._layout = ViewLayout(model, task.frames)
        self._last_tick = round((time_limit or task.time_limit) / TICK)
        self._hold_ticks = round(task.success_hold / TICK)
        self._held = -1
        self._down = 0
        self._lies = lies(task.scene.robot)
        self.parameters = task.table.defaults.parameters

    def verdict(self, tick: int, state: np.ndarray) -> Ending | None:
        """Return success, a fall, one of the task's failures, a timeout, or None to go on.

        Raises:
            TaskError: a test of the task's is at fault.
        """
        view = self.view(state)
        success = self._holds("success", self._task.success, view)
        self._held = self._held + 1 if success else -1
        if self._held >= self._hold_ticks:
            return Ending(End.SUCCESS)
        down = self._lies(view)[0, 0]
        self._down = self._down + 1 if down else 0
        if self._down * TICK > FALL_S:
            return Ending(End.FELL)
        if tick < self._last_tick:
            return None
        failure = next(self._failures(view), None)
        return Ending(End.TIMEOUT) if failure is None else Ending(End.FAILURE, failure)

    def judge(self, state: np.ndarray) -> tuple[bool, list[str]]:
        """Return whether a state is a success, and which failures hold, whatever came before.

        Raises:
            TaskError: a test of the task's is at fault.
        """
        view = self.view(state)
        return self._holds("success", self._task.success, view), [*self._failures(view)]

    def _failures(self, view: View) -> Iterator[str]:
        for name, test in self._task.failure.items():
            if self._holds(f"failure {name!r}", test, view):
                yield name

    @staticmethod
    def _holds(what: str, test: Predicate, view: View) -> bool:
        return bool(truths_of(what, test, view)[0, 0])

    def view(self, state: np.ndarray) -> View:
        """Name the arrays of one state: one rollout of one step, without an action."""
        self._data.qpos[:], self._data.qvel[:] = np.split(state, [self._model.nq])
        mujoco.mj_kinematics(self._model, self._data)
        return self._layout.at(
            self._data,
            len(self._task.actions.names),
            self._task.table.named(self.parameters),
        )
