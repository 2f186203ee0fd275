"""A run as Rerun entities; the live tracer and the after-run conversion both write through this."""

from collections import deque
from typing import Literal

import mujoco
import numpy as np
import rerun as rr

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.report import PlanReport
from sumo_dist.tasks.task import Task
from sumo_dist.timing import PLAN_PERIOD, TICK
from sumo_dist.view import about
from sumo_dist.view.blueprint import layout
from sumo_dist.view.marks import ELITE, GOAL, ON_FLOOR, Color, goal_rings, ranked, way_colors
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.scene import SceneLog

Level = Literal["info", "warning", "error"]

CHUNK_TICKS = 5  # states sent at a time: a quarter of the cost of one by one
TRAIL_POINTS = 600  # of an executed trail, one a chunk: the last minute

_LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}
_SERIES: tuple[Color, ...] = (  # colours of plots, legible on dark and on light
    (66, 146, 214),
    (238, 130, 50),
    (44, 160, 112),
    (204, 96, 160),
    (148, 118, 200),
    (200, 160, 40),
    (214, 70, 70),
    (130, 130, 130),
)


class RunLogger:
    """Writes one run: the scene at once, then states, plans, candidates and events as they come."""

    def __init__(
        self,
        out: Outputs,
        task: Task,
        episode: EpisodeConfig,
        distributed: bool,
        model: mujoco.MjModel | None = None,
    ) -> None:
        """Log all that stays as it is.

        Args:
            out: where to write.
            task: what the robot does.
            episode: how it plans.
            distributed: there are rollout workers to watch.
            model: of the task's scene; compiled by default.
        """
        self._out, self._task, self._distributed = out, task, distributed
        self._parameters = episode.cost(task).parameters
        self._goal = task.goal_position(task.table.named(self._parameters))
        self._planner = episode.planner
        self._model = model or compile_model(task.scene, PLANT)
        self._data = mujoco.MjData(self._model)
        self._scene = SceneLog(out, self._model, CHUNK_TICKS)
        self._colors = way_colors(task)
        self._trails = {name: deque[np.ndarray](maxlen=TRAIL_POINTS) for name in self._colors}
        self._mover = "robot" if task.goal_frame == "base" else task.goal_frame  # has the goal
        self._ticks: list[int] = []
        self._distances: list[float] = []
        self._arranged = False
        self._said: dict[tuple[str, str], str] = {}  # last text by service and counter
        self._log_text("about/scene", about.scene(task, episode))
        self._log_text("about/cost", about.cost(task))
        if self._goal is not None:
            self._log_goal(self._goal, tick=0)
        self._name_plots()

    def log_state(self, tick: int, state: np.ndarray) -> None:
        """Log a state (nq + nv,); it is sent with others, see CHUNK_TICKS."""
        self._data.qpos[:] = state[: self._model.nq]
        mujoco.mj_kinematics(self._model, self._data)
        self._scene.add(tick, self._data)
        self._ticks.append(tick)
        if self._goal is not None:
            to_goal = self._position(self._task.goal_frame) - self._goal
            self._distances.append(float(np.linalg.norm(to_goal)))
        if not self._arranged:
            self._arrange()
        if len(self._ticks) == CHUNK_TICKS:
            self._send_chunk()

    def log_plan(self, report: PlanReport, budget_ms: float = PLAN_PERIOD * 1e3) -> None:
        """Log a plan's costs and timing at its tick; `budget_ms` is the wall time it may take."""
        tick = report.plan.tick
        self._follow_goal(tick, report.parameters)
        finite = report.costs[report.finite]
        current = report.costs[0] if report.finite[0] else np.nan
        best, mean = (finite.min(), finite.mean()) if len(finite) else (np.nan, np.nan)
        self._plot("cost", tick, [current, best, mean])
        if report.finite[0]:
            self._plot("terms", tick, report.terms)
        age_ms = report.age_ticks * TICK * 1e3
        self._plot("timing", tick, [report.plan_ms, budget_ms, age_ms])
        if self._distributed:
            self._plot("workers/rollouts", tick, [report.lost, report.reissued])
        if report.failed:
            text = f"plan {report.plan.number} failed: no candidate has a finite cost"
            self.log_event(tick, "warning", text)

    def log_workers(self, tick: int, alive: int) -> None:
        """Log how many rollout workers there are."""
        self._plot("workers/alive", tick, [alive])

    def log_pace(self, tick: int, worker: str, rollouts_per_s: float) -> None:
        """Log how fast a worker is."""
        self._out.log(["plots", "pace", worker], rr.Scalars([rollouts_per_s]), tick=tick)

    def log_health(self, tick: int, source: str, name: str, value: float | str) -> None:
        """Log what a service tells of itself: a number as a series, a text whenever it changes."""
        path: list[object] = ["health", source, name]
        if not isinstance(value, str):
            self._out.log(path, rr.Scalars([value]), tick=tick)
        elif self._said.get((source, name)) != value:
            self._said[source, name] = value
            self._out.log(path, rr.TextLog(value), tick=tick)

    def log_candidates(self, tick: int, costs: np.ndarray, traces: np.ndarray) -> None:
        """Log the futures that a plan was chosen from.

        Args:
            tick: of the state they start from.
            costs: (B,) +inf where there is no rollout.
            traces: (B, F, P, 3) paths of the task's trail frames, world [m].
        """
        elites, others, shades = ranked(costs, self._planner)
        _, frames, points, _ = traces.shape
        samples = rr.LineStrips3D(
            traces[others].reshape(len(others) * frames, points, 3),
            colors=np.repeat(shades, frames, axis=0),
            radii=rr.Radius.ui_points(0.6),
        )
        best = rr.LineStrips3D(
            traces[elites].reshape(len(elites) * frames, points, 3),
            colors=[ELITE],
            radii=rr.Radius.ui_points(1.3),
        )
        self._out.log("world/plan/samples", samples, tick=tick)
        self._out.log("world/plan/elites", best, tick=tick)

    def log_event(self, tick: int, level: Level, text: str) -> None:
        """Log one line for people."""
        self._out.log("events", rr.TextLog(text, level=_LEVELS[level]), tick=tick)

    def flush(self) -> None:
        """Send what is waiting for a full chunk."""
        self._send_chunk()
        self._out.flush()

    def _send_chunk(self) -> None:
        if not self._ticks:
            return
        self._scene.flush()
        if self._distances:
            self._out.send("plots/task", self._ticks, rr.Scalars.columns(scalars=self._distances))
        for name, trail in self._trails.items():
            trail.append(np.append(self._position(name)[:2], ON_FLOOR))
            strip = rr.LineStrips3D(
                [np.array(trail)], colors=[self._colors[name]], radii=rr.Radius.ui_points(2.0)
            )
            self._out.log(f"world/trail/{name}", strip, tick=self._ticks[-1])
        self._ticks, self._distances = [], []

    def _arrange(self) -> None:
        """Lay out the viewer around where everything starts."""
        points = [self._position(name) for name in self._trails]
        if self._goal is not None:
            points.append(self._goal)
        goal = (self._mover, self._distances[0]) if self._distances else None
        self._out.arrange(layout(np.array(points), self._task.movers, goal, self._distributed))
        self._arranged = True

    def _position(self, name: str) -> np.ndarray:
        ref: FrameRef = self._task.frames[name]
        at = self._data.site(ref.name) if ref.kind == "site" else self._data.body(ref.name)
        return at.xpos.copy()

    def _plot(self, name: str, tick: int, values: list[float] | np.ndarray) -> None:
        self._out.log(f"plots/{name}", rr.Scalars(values), tick=tick)

    def _log_text(self, path: str, text: str) -> None:
        self._out.log(path, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def _name_plots(self) -> None:
        for plot, names in {
            "task": [f"{self._mover} to goal"],
            "cost": ["current plan", "best candidate", "mean of all"],
            "terms": [term.name for term in self._task.cost],
            "timing": ["planning time", "budget", "age of the plan's state"],
            "workers/alive": ["workers alive"],
            "workers/rollouts": ["rollouts lost", "rollouts sent twice"],
        }.items():
            shades = _SERIES[1:] if plot == "workers/rollouts" else _SERIES
            lines = rr.SeriesLines(names=names, colors=shades[: len(names)])
            self._out.log(f"plots/{plot}", lines)

    def _follow_goal(self, tick: int, parameters: np.ndarray) -> None:
        """Draw the goal where the parameters of a plan have it."""
        if np.array_equal(parameters, self._parameters):
            return
        self._parameters = parameters
        self._goal = self._task.goal_position(self._task.table.named(parameters))
        if self._goal is not None:
            self._log_goal(self._goal, tick)

    def _log_goal(self, goal: np.ndarray, tick: int) -> None:
        """Draw the goal, and rings on the floor below it."""
        rings = rr.LineStrips3D(goal_rings(goal), colors=[GOAL], radii=rr.Radius.ui_points(2.0))
        self._out.log("world/goal/rings", rings, tick=tick)
        point = rr.Points3D([goal], colors=[GOAL], radii=[0.04], labels=["goal"])
        self._out.log("world/goal/point", point, tick=tick)
