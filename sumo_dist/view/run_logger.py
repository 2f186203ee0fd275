"""A run as Rerun entities; the live tracer and the after-run conversion both write through this."""

from collections import deque
from typing import Literal

import mujoco
import numpy as np
import rerun as rr

from sumo_dist.costs.view import View, ViewLayout
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.report import PlanReport
from sumo_dist.tasks.task import Task
from sumo_dist.timing import PLAN_PERIOD
from sumo_dist.view import about
from sumo_dist.view.about import legible
from sumo_dist.view.blueprint import frame, layout
from sumo_dist.view.eye import Shot, clearest_azimuth, direction
from sumo_dist.view.ghost import EVERY_TICKS, Foresight, GhostLog
from sumo_dist.view.marks import (
    ELITE,
    GOAL,
    ON_FLOOR,
    SHOWN,
    TRACE_POINTS,
    eye_azimuth,
    goal_rings,
    ranked,
    thinned,
    way_colors,
)
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.plots import PlotLog, plots
from sumo_dist.view.scene import SceneLog
from sumo_dist.view.verdict import Verdict

Level = Literal["info", "warning", "error"]

CHUNK_TICKS = 5  # states sent at a time: a quarter of the cost of one by one
TRAIL_TICKS = 25  # of robot time between points of an executed trail
TRAIL_POINTS = 120  # of it: the last minute
CANDIDATE_TICKS = 5  # of robot time at least between two plans whose candidates are drawn
VERDICT_TICKS = 10  # of robot time between two verdicts
HEALTH_TICKS = 50  # of robot time between two numbers of the same kind

_ELEVATION = 28.0  # of the eye, seen from its target [deg]
_LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}


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
        self._frames = ViewLayout(self._model, task.frames)
        self._colors = way_colors(task)
        self._trails = {name: deque[np.ndarray](maxlen=TRAIL_POINTS) for name in self._colors}
        self._plots = PlotLog(out, task, distributed)
        self._foresight = Foresight(task, episode)
        self._ghost = GhostLog(out, task, self._model)
        self._verdict = Verdict()
        self._next = {"trail": 0, "candidates": 0, "ghost": 0, "verdict": 0}  # ticks
        self._arranged = False
        self._alive = 0
        self._said: dict[tuple[str, str], tuple[int, float | str]] = {}  # last of each counter
        self._line = ""
        self._log_text("about/scene", about.scene(task, episode))
        self._log_text("about/cost", about.cost(task))
        if self._goal is not None:
            self._log_goal(self._goal, tick=0)

    def log_state(self, tick: int, state: np.ndarray, now: float | None = None) -> None:
        """Log a state (nq + nv,) seen at time.monotonic() `now` [s]; see also CHUNK_TICKS."""
        view = self._view(state)
        self._scene.add(tick, self._data)
        self._plots.add_state(tick, view, self._goal)
        if now is not None:
            self._verdict.add_tick(tick, now)
        if not self._arranged:
            self._arrange(view)
        if self._due("trail", tick, TRAIL_TICKS):
            self._extend_trails(tick, view)
        if self._due("verdict", tick, VERDICT_TICKS):
            self._log_verdict(tick)

    def log_plan(self, report: PlanReport, budget_ms: float = PLAN_PERIOD * 1e3) -> None:
        """Log a plan's costs and timing at its tick; `budget_ms` is the wall time it may take."""
        tick = report.plan.tick
        self._follow_goal(tick, report.parameters)
        self._plots.add_plan(report, budget_ms)
        self._verdict.add_plan(report, budget_ms)
        if self._distributed:
            self._plots.add("workers", tick, [self._alive, report.lost, report.reissued])
        if report.failed:
            text = f"plan {report.plan.number} failed: no candidate has a finite cost"
            self.log_event(tick, "warning", text)

    def log_ghost(
        self, report: PlanReport, tick: int, state: np.ndarray, memory: np.ndarray
    ) -> None:
        """Draw where a plan leads from a tick's state and policy memory, if that is due."""
        if self._due("ghost", tick, EVERY_TICKS):
            self._ghost.show(tick, self._foresight.end_of(report.plan, tick, state, memory))

    def log_workers(self, tick: int, alive: int) -> None:
        """Log how many rollout workers there are."""
        self._alive = alive
        self._verdict.set_alive(alive)
        self._log_verdict(tick)

    def log_worker(self, tick: int, worker: str, state: str, rollouts_per_s: float) -> None:
        """Log how a worker is, and how fast."""
        self._verdict.add_worker(worker, state, rollouts_per_s)
        if self._news(tick, worker, "pace", rollouts_per_s):
            self._out.log(["plots", "pace", worker], rr.Scalars([rollouts_per_s]), tick=tick)

    def log_mode(self, tick: int, mode: str) -> None:
        """Log what the robot does."""
        self._verdict.set_mode(mode)
        if self._news(tick, "robot", "mode", mode):
            self._log_verdict(tick)

    def log_health(self, tick: int, source: str, name: str, value: float | str) -> None:
        """Log what a service tells of itself, when it changes: a number, or a text."""
        if not self._news(tick, source, name, value):
            return
        said = rr.TextLog(legible(value)) if isinstance(value, str) else rr.Scalars([value])
        self._out.log(["health", source, name], said, tick=tick)

    def log_candidates(self, tick: int, costs: np.ndarray, traces: np.ndarray) -> None:
        """Log the futures that a plan was chosen from, if that is due.

        Args:
            tick: of the state they start from.
            costs: (B,) +inf where there is no rollout.
            traces: (B, F, P, 3) paths of the task's trail frames, world [m].
        """
        if not self._due("candidates", tick, CANDIDATE_TICKS):
            return
        elites, others, shades = ranked(costs, self._planner)
        chosen = thinned(len(others), SHOWN)
        points = thinned(traces.shape[2], TRACE_POINTS)
        drawn = traces[others[chosen]][:, :, points]
        samples = rr.LineStrips3D(
            drawn.reshape(-1, *drawn.shape[2:]),
            colors=np.repeat(shades[chosen], traces.shape[1], axis=0),
            radii=rr.Radius.ui_points(0.6),
        )
        best = rr.LineStrips3D(
            traces[elites].reshape(-1, *traces.shape[2:]),
            colors=[ELITE],
            radii=rr.Radius.ui_points(1.3),
        )
        self._out.log("world/plan/samples", samples, tick=tick)
        self._out.log("world/plan/elites", best, tick=tick)

    def log_event(self, tick: int, level: Level, text: str) -> None:
        """Log one line for people."""
        self._out.log("events", rr.TextLog(legible(text), level=_LEVELS[level]), tick=tick)

    def log_end(self, tick: int, reason: str, again: str) -> None:
        """Log how the run ended, and the command that shows it again, "" for none."""
        self._verdict.end(reason, again)
        self._log_verdict(tick)

    def flush(self) -> None:
        """Send what is waiting for a full chunk."""
        self._scene.flush()
        self._plots.flush()
        self._out.flush()

    def close(self) -> None:
        """Free what plans are rolled out with."""
        self._foresight.close()

    def _view(self, state: np.ndarray) -> View:
        """Put the model into a state (nq + nv,) and name what is in it."""
        self._data.qpos[:], self._data.qvel[:] = np.split(state, [self._model.nq])
        mujoco.mj_kinematics(self._model, self._data)
        parameters = self._task.table.named(self._parameters)
        return self._frames.at(self._data, len(self._task.actions.names), parameters)

    def _due(self, what: str, tick: int, period: int) -> bool:
        """Whether it is time for something that happens once in so many ticks."""
        if tick < self._next[what]:
            return False
        self._next[what] = tick + period
        return True

    def _news(self, tick: int, source: str, name: str, value: float | str) -> bool:
        """Whether a value is another one than last told; numbers are told every HEALTH_TICKS."""
        before, last = self._said.get((source, name), (-HEALTH_TICKS, None))
        recent = not isinstance(value, str) and tick < before + HEALTH_TICKS
        if value == last or (recent and last is not None):
            return False
        self._said[source, name] = tick, value
        return True

    def _extend_trails(self, tick: int, view: View) -> None:
        for name, trail in self._trails.items():
            trail.append(np.append(view[name].pos[0, 0, :2], ON_FLOOR))
            strip = rr.LineStrips3D(
                [np.array(trail)], colors=[self._colors[name]], radii=rr.Radius.ui_points(2.0)
            )
            self._out.log(f"world/trail/{name}", strip, tick=tick)

    def _arrange(self, view: View) -> None:
        """Lay out the viewer around where everything starts."""
        points = [view[name].pos[0, 0] for name in self._trails]
        if self._goal is not None:
            points.append(self._goal)
        target, distance = frame(np.array(points))
        shots = [Shot(qpos, target, distance) for qpos in self._way_ahead(points[0])]
        base, preferred = self._task.scene.robot.base, eye_azimuth(points[0], target)
        azimuth = clearest_azimuth(self._model, base, shots, _ELEVATION, preferred)
        eye = target + distance * direction(azimuth, _ELEVATION)
        shown = plots(self._task, self._distributed)
        self._out.arrange(layout(eye, target, self._task.movers, shown, self._distributed))
        self._arranged = True

    def _way_ahead(self, start: np.ndarray) -> list[np.ndarray]:
        """Positions (nq,) to be seen: the start, and a robot that goes to a goal, on its way."""
        if self._goal is None or self._task.goal_frame != "base":
            return [self._data.qpos.copy()]
        way = []
        for share in np.linspace(0.0, 1.0, 5):
            qpos = self._data.qpos.copy()
            at = self._model.body(self._task.scene.robot.base).jntadr[0]
            xy = slice(self._model.jnt_qposadr[at], self._model.jnt_qposadr[at] + 2)
            qpos[xy] += share * (self._goal - start)[:2]
            way.append(qpos)
        return way

    def _log_verdict(self, tick: int) -> None:
        line = self._verdict.line()
        if line != self._line:
            self._line = line
            self._log_text("verdict", line, tick)

    def _log_text(self, path: str, text: str, tick: int | None = None) -> None:
        document = rr.TextDocument(legible(text), media_type=rr.MediaType.MARKDOWN)
        self._out.log(path, document, tick=tick)

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
