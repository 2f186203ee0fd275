"""A run as Rerun entities; the live tracer and the after-run conversion both write through this."""

from collections.abc import Sequence
from typing import Literal

import mujoco
import numpy as np
import rerun as rr

from sumo_dist.costs.view import View, ViewLayout
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.report import PlanReport
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK
from sumo_dist.view import about
from sumo_dist.view.about import legible
from sumo_dist.view.ahead import AheadLog
from sumo_dist.view.blueprint import Eye, Layout, frame, layout
from sumo_dist.view.eye import Shot, clearest_azimuth, direction
from sumo_dist.view.fleet import Fleet
from sumo_dist.view.forces import Forces
from sumo_dist.view.foresight import EVERY_TICKS, LIVE_SHARE, Allowance, Foresight
from sumo_dist.view.marks import (
    ELITE,
    GOAL,
    SHOWN,
    TRACE_POINTS,
    eye_azimuth,
    goal_rings,
    ranked,
    thinned,
)
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.plots import Plot, PlotLog, plots
from sumo_dist.view.scene import SceneLog, left_out
from sumo_dist.view.search import SearchLog
from sumo_dist.view.states import StateLog
from sumo_dist.view.trail_log import TrailLog
from sumo_dist.view.verdict import Verdict

Level = Literal["info", "warning", "error"]

CHUNK_TICKS = 5  # states sent at a time: a quarter of the cost of one by one
CANDIDATE_TICKS = 5  # of robot time at least between two plans whose candidates are drawn
VERDICT_TICKS = 10  # of robot time between two verdicts
HEALTH_TICKS = 50  # of robot time between two numbers of the same kind
LATE = 2.0  # periods after which the next plan is late

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
        first: Layout = "drive",
        also: Sequence[Plot] = (),
    ) -> None:
        """Log all that stays as it is.

        Args:
            out: where to write.
            task: what the robot does.
            episode: how it plans.
            distributed: there are rollout workers to watch.
            model: of the task's scene; compiled by default.
            first: the layout that is open at first.
            also: plots that somebody else writes, in a layout of their own, open at first.
        """
        self._also = also
        self._out, self._task, self._distributed = out, task, distributed
        self._first: Layout = first
        self._parameters = episode.cost(task).parameters
        self._goal = task.goal_position(task.table.named(self._parameters))
        self._planner = episode.planner
        self._model = model or compile_model(task.scene, PLANT)
        self._data = mujoco.MjData(self._model)
        self._scene = SceneLog(out, self._model, CHUNK_TICKS)
        self._frames = ViewLayout(self._model, task.frames)
        self._trails = TrailLog(out, task)
        pairs = Forces(self._model, task.scene.robot.base).pairs
        self._shown = plots(task, distributed, pairs)
        self._period_ms = episode.planner.period * 1e3
        self._plots = PlotLog(out, task, self._shown)
        self._foresight = Foresight(task, episode)
        self._allowance = Allowance(LIVE_SHARE if distributed else 1.0)
        self._ahead = AheadLog(out, task, self._model, self._plots)
        self._search = SearchLog(out, task.actions, episode.planner)
        self._states = StateLog(out)
        self._fleet = Fleet(self._plots)
        self._plan_tick: int | None = None
        self._verdict = Verdict()
        self._next = {"candidates": 0, "ghost": 0, "verdict": 0, "fleet": 0}  # ticks
        self._arranged = False
        self._said: dict[tuple[str, str], tuple[int, float | str]] = {}  # last of each counter
        self._line = ""
        self._log_text("about/scene", about.scene(task, episode, left_out(self._model)))
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
            self._ahead.begin(tick, self._data)
        self._ahead.reached(tick, view)
        self._states.reached(tick)
        if self._plan_tick is not None:
            age_ms = max(0, tick - self._plan_tick) * TICK * 1e3
            self._plots.add_age(tick, age_ms, LATE * self._period_ms)
        self._trails.extend(tick, view)
        if self._due("verdict", tick, VERDICT_TICKS):
            self._log_verdict(tick)

    def log_plan(self, report: PlanReport, speed: float = 1.0) -> None:
        """Log a plan's costs and timing at its tick; `speed` is robot time per wall time."""
        tick, budget_ms = report.plan.tick, self._period_ms / speed
        self._follow_goal(tick, report.parameters)
        self._plots.add_plan(report, budget_ms)
        self._verdict.add_plan(report, budget_ms)
        self._states.plan(report, budget_ms)
        self._plan_tick = tick
        if report.failed:
            text = f"plan {report.plan.number} failed: no candidate has a finite cost"
            self.log_event(tick, "warning", text)

    def log_ghost(
        self, report: PlanReport, tick: int, state: np.ndarray, memory: np.ndarray
    ) -> None:
        """Draw where a plan leads from a tick's state and policy memory, if that is due.

        Beside a live run this takes no more than a share of the time, LIVE_SHARE.
        """
        if not self._allowance.left or not self._due("ghost", tick, EVERY_TICKS):
            return
        with self._allowance:
            self._search.show(report.plan)
            ahead = self._foresight.of(report.plan, tick, state, memory, report.parameters)
            if ahead is not None:
                self._ahead.show(ahead, report)

    def follow_settings(self, settings: PlannerConfig) -> None:
        """Take up the settings that plans are made with from now on."""
        self._search.follow(settings)

    def log_workers(self, tick: int, alive: int) -> None:
        """Log how many rollout workers there are."""
        self._verdict.set_alive(alive)
        self._fleet.set_alive(alive)
        self._log_verdict(tick)

    def log_worker(self, tick: int, worker: str, state: str, rollouts_per_s: float) -> None:
        """Log how a worker is, and how fast."""
        self._verdict.add_worker(worker, state, rollouts_per_s)
        self._states.worker(tick, worker, state)
        self._fleet.add_worker(worker, state, rollouts_per_s)

    def log_worker_gone(self, tick: int, worker: str) -> None:
        """Log that a worker is no more."""
        self._verdict.remove_worker(worker)
        self._states.gone(tick, worker)
        self._fleet.remove_worker(worker)
        self._said = {key: last for key, last in self._said.items() if key[0] != worker}

    def log_fleet(self, tick: int, dropped: int) -> None:
        """Log the pool as it was told of so far; of `dropped` messages nothing is shown."""
        if self._distributed and self._due("fleet", tick, VERDICT_TICKS):
            self._fleet.log(tick, dropped)

    def log_mode(self, tick: int, mode: str) -> None:
        """Log what the robot does."""
        self._verdict.set_mode(mode)
        self._states.mode(mode)
        if self._news(tick, "robot", "mode", mode):
            self._log_verdict(tick)

    def log_health(self, tick: int, source: str, name: str, value: float | str) -> None:
        """Log what a service tells of itself, when it changes: a number, or a text."""
        self._fleet.count(source, name, value)
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
        self._states.end(tick, reason)
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

    def _arrange(self, view: View) -> None:
        """Lay out the viewer around where everything starts."""
        points = [view[name].pos[0, 0] for name in self._trails.names]
        if self._goal is not None:
            points.append(self._goal)
        target, distance = frame(np.array(points))
        shots = [Shot(qpos, target, distance) for qpos in self._way_ahead(points[0])]
        base, preferred = self._task.scene.robot.base, eye_azimuth(points[0], target)
        azimuth = clearest_azimuth(self._model, base, shots, _ELEVATION, preferred)
        eye = Eye(target + distance * direction(azimuth, _ELEVATION), target)
        above = eye.above(points[-1][:2] - points[0][:2])
        live = self._distributed
        self._out.arrange(
            layout(eye, above, self._task.movers, self._shown, live, self._first, self._also)
        )
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
