"""Where a plan leads: a translucent twin at its end, ways, its cost and forces on the way."""

from collections import deque
from collections.abc import Mapping
from contextlib import suppress

import mujoco
import numpy as np
import rerun as rr

from sumo_dist.costs.terms import INDICATORS
from sumo_dist.costs.view import View
from sumo_dist.errors import TaskError
from sumo_dist.planner.report import PlanReport
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK
from sumo_dist.view.charts import Chart, Curve
from sumo_dist.view.forces import Forces
from sumo_dist.view.foresight import EVERY_TICKS, Ahead
from sumo_dist.view.marks import GHOST, ON_FLOOR, line_color
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.plots import LEAD_TICKS, PlotLog, compared
from sumo_dist.view.scene import SceneLog, Twin

WAY_POINTS = 16  # of a planned way

TERMS = Chart("charts/terms", "s")

TWIN = Twin("world/plan/twin", "plan", GHOST)


class AheadLog:
    """Draws what plans lead to, and compares it with what came."""

    def __init__(self, out: Outputs, task: Task, model: mujoco.MjModel, plots: PlotLog) -> None:
        """Log the twin's geometry; the model is the plant's."""
        self._out, self._task, self._model = out, task, model
        self._plots = plots
        self._forces: Forces | None = None  # of the planning model
        self._data = mujoco.MjData(model)
        self._twin = SceneLog(out, model, chunk_ticks=1, twin=TWIN)
        self._begun = False
        self._rows: deque[tuple[int, np.ndarray]] = deque()  # forces at ticks to come
        self._expected: deque[tuple[int, Mapping[str, np.ndarray]]] = deque()
        self._peak = 0.0

    def begin(self, tick: int, data: mujoco.MjData) -> None:
        """Put the twin where the robot and the objects are, before there is a plan."""
        if not self._begun:
            self._begun = True
            self._twin.add(tick, data)

    def show(self, ahead: Ahead, report: PlanReport) -> None:
        """Draw a plan's future."""
        self._data.qpos[:] = ahead.states[-1][: self._model.nq]
        mujoco.mj_kinematics(self._model, self._data)
        self._twin.add(ahead.tick, self._data)
        for name in dict.fromkeys(("base", *self._task.trails)):
            self._log_way(name, ahead)
        self._rows.clear()
        if self._forces is None:
            self._forces = Forces(ahead.model, self._task.scene.robot.base)
        forces = self._forces.along(ahead, EVERY_TICKS)
        self._rows.extend(enumerate(forces, ahead.tick + 1))
        if len(ahead.states) >= LEAD_TICKS:
            at = {n: ahead.view[n].pos[0, LEAD_TICKS - 1] for n in compared(self._task)}
            self._expected.append((ahead.tick + LEAD_TICKS, at))
        with suppress(TaskError):  # that the planner tells of
            self._log_terms(ahead, report)

    def reached(self, tick: int, view: View) -> None:
        """Take note of what came."""
        while self._rows and self._rows[0][0] <= tick:
            self._plots.add("forces", *self._rows.popleft())
        while self._expected and self._expected[0][0] <= tick:
            then, at = self._expected.popleft()
            if then == tick:
                off = [np.linalg.norm(view[n].pos[0, 0] - at[n]) for n in at]
                self._plots.add("off", tick, np.array(off))

    def _log_way(self, name: str, ahead: Ahead) -> None:
        points = ahead.view[name].pos[0]
        way = points[np.linspace(0, len(points) - 1, WAY_POINTS).round().astype(int)].copy()
        if name == "base":
            way[:, 2] = ON_FLOOR
        strip = rr.LineStrips3D([way], colors=[GHOST], radii=rr.Radius.ui_points(2.0))
        self._out.log(f"world/plan/way/{name}", strip, tick=ahead.tick)

    def _log_terms(self, ahead: Ahead, report: PlanReport) -> None:
        """Draw what each term costs at each moment of the plan."""
        cost = self._task.cost
        courses = [w * t.course(ahead.view)[0] for w, t in zip(report.weights, cost, strict=True)]
        peaks = [
            np.abs(course).max(initial=0.0)
            for course, term in zip(courses, cost, strict=True)
            if term.reduction not in INDICATORS and np.isfinite(course).all()
        ]
        self._peak = max([0.98 * self._peak, *(1.1 * peak for peak in peaks), 1e-3])
        low = -self._peak if any((course < 0.0).any() for course in courses) else 0.0
        times = TICK * np.arange(1, len(ahead.states) + 1)
        curves = [
            Curve(
                f"{term.name} {round(float(course.mean()), 2):g}",
                times,
                np.nan_to_num(course),
                line_color(i),
            )
            for i, (course, term) in enumerate(zip(courses, cost, strict=True))
        ]
        TERMS.log(self._out, ahead.tick, curves, times[-1], (low, self._peak))
