"""A run as Rerun entities; the live tracer and the after-run conversion both write through this."""

from collections import deque
from typing import Literal

import mujoco
import numpy as np
import rerun as rr

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.report import PlanReport
from sumo_dist.rollout.interface import TICK, FrameRef
from sumo_dist.tasks.task import Task
from sumo_dist.view import about, colors
from sumo_dist.view.blueprint import layout
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.scene import SceneLog

Level = Literal["info", "warning", "error"]

CHUNK_TICKS = 5  # states sent at a time: a quarter of the cost of one by one
TRAIL_POINTS = 600  # of an executed trail, one a chunk: the last minute
PERIOD_MS = 50.0  # robot time between plans

_LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}
_ON_FLOOR = 0.01  # height of what is drawn on the floor [m]
_TRAILS = {"base": colors.BASE_TRAIL, "object": colors.OBJECT_TRAIL}


class RunLogger:
    """Writes one run: the scene at once, then states, plans, candidates and events as they come."""

    def __init__(self, out: Outputs, task: Task, episode: EpisodeConfig, distributed: bool) -> None:
        """Log all that stays as it is.

        Args:
            out: where to write.
            task: what the robot does.
            episode: how it plans.
            distributed: there are rollout workers to watch.
        """
        self._out, self._task, self._distributed = out, task, distributed
        self._elites = about.highlighted(episode)
        self._model = compile_model(task.scene, PLANT)
        self._data = mujoco.MjData(self._model)
        self._scene = SceneLog(out, self._model, CHUNK_TICKS)
        self._trails = {
            name: deque[np.ndarray](maxlen=TRAIL_POINTS) for name in _TRAILS if name in task.frames
        }
        self._ticks: list[int] = []
        self._distances: list[float] = []
        self._arranged = False
        self._log_text("about/scene", about.scene(task, episode))
        self._log_text("about/cost", about.cost(task))
        self._log_goal()
        self._name_plots()

    def log_state(self, tick: int, state: np.ndarray) -> None:
        """Log a state (nq + nv,); it is sent with others, see CHUNK_TICKS."""
        self._data.qpos[:] = state[: self._model.nq]
        mujoco.mj_kinematics(self._model, self._data)
        if not self._arranged:
            self.arrange(live=True)
        self._scene.add(tick, self._data)
        self._ticks.append(tick)
        if "object" in self._trails:
            to_goal = self._position("object") - np.array(self._task.goal)
            self._distances.append(float(np.linalg.norm(to_goal)))
        if len(self._ticks) == CHUNK_TICKS:
            self._send_chunk()

    def log_plan(self, report: PlanReport, budget_ms: float = PERIOD_MS) -> None:
        """Log a plan's costs and timing at its tick; `budget_ms` is the wall time it may take."""
        tick = report.plan.tick
        finite = report.costs[report.finite]
        current = report.costs[0] if report.finite[0] else np.nan
        best, mean = (finite.min(), finite.mean()) if len(finite) else (np.nan, np.nan)
        self._plot("cost", tick, [current, best, mean])
        if report.finite[0]:
            self._plot("terms", tick, report.terms)
        age_ms = report.age_ticks * TICK * 1e3
        self._plot("timing", tick, [report.plan_ms, budget_ms, age_ms])
        if self._distributed:
            self._plot("workers", tick, [report.workers, report.lost, report.reissued])
        if report.failed:
            text = f"plan {report.plan.number} failed: no candidate has a finite cost"
            self.log_event(tick, "warning", text)

    def log_candidates(self, tick: int, costs: np.ndarray, traces: np.ndarray) -> None:
        """Log the futures that a plan was chosen from.

        Args:
            tick: of the state they start from.
            costs: (B,) +inf where there is no rollout.
            traces: (B, F, P, 3) paths of the task's trail frames, world [m].
        """
        order = np.argsort(costs, kind="stable")
        order = order[np.isfinite(costs[order])]
        elites, others = order[: self._elites], order[self._elites :][::-1]  # best drawn last
        shades = colors.cost_colors(costs[order])[::-1]
        frames = traces.shape[1]
        samples = rr.LineStrips3D(
            traces[others].reshape(-1, *traces.shape[2:]),
            colors=np.repeat(shades[: len(others)], frames, axis=0),
            radii=rr.Radius.ui_points(0.6),
        )
        best = rr.LineStrips3D(
            traces[elites].reshape(-1, *traces.shape[2:]),
            colors=[colors.ELITE],
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

    def arrange(self, live: bool) -> None:
        """Lay out the viewer around the state logged last."""
        points = [self._position(name) for name in self._trails]
        self._out.arrange(layout(np.array([*points, self._task.goal]), live, self._distributed))
        self._arranged = True

    def _send_chunk(self) -> None:
        if not self._ticks:
            return
        self._scene.flush()
        if self._distances:
            self._out.send("plots/task", self._ticks, rr.Scalars.columns(scalars=self._distances))
        for name, trail in self._trails.items():
            trail.append(np.append(self._position(name)[:2], _ON_FLOOR))
            strip = rr.LineStrips3D(
                [np.array(trail)], colors=[_TRAILS[name]], radii=rr.Radius.ui_points(2.0)
            )
            self._out.log(f"world/trail/{name}", strip, tick=self._ticks[-1])
        self._ticks, self._distances = [], []

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
            "task": ["object to goal"],
            "cost": ["current plan", "best candidate", "mean of all"],
            "terms": [term.name for term in self._task.cost],
            "timing": ["planning time", "budget", "age of the plan's state"],
            "workers": ["workers alive", "rollouts lost", "rollouts sent twice"],
        }.items():
            lines = rr.SeriesLines(names=names, colors=colors.SERIES[: len(names)])
            self._out.log(f"plots/{plot}", lines)

    def _log_goal(self) -> None:
        """Draw rings on the floor and a post up to the goal."""
        goal = np.array(self._task.goal)
        angles = np.linspace(0.0, 2 * np.pi, 49)
        circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(49)], axis=1)
        foot = np.array([goal[0], goal[1], _ON_FLOOR])
        rings = [foot + radius * circle for radius in (0.1, 0.25, 0.4)]
        self._out.log(
            "world/goal/rings",
            rr.LineStrips3D(rings, colors=[colors.GOAL], radii=rr.Radius.ui_points(2.0)),
        )
        self._out.log(
            "world/goal/point",
            rr.Points3D([goal], colors=[colors.GOAL], radii=[0.04], labels=["goal"]),
        )
