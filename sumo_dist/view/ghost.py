"""Where a plan leads: it is rolled out here, once, and its end drawn as a translucent twin."""

from contextlib import suppress
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.rollout.interface import Engine
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK
from sumo_dist.view.marks import GHOST, ON_FLOOR
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.scene import VISIBLE_GROUPS

EVERY_TICKS = 12  # of robot time between two ghosts; four a second
WAY_POINTS = 16  # of the base's planned way

_Geom = mujoco.mjtGeom
_FILL = rr.components.FillMode.TransparentFillMajorWireframe


class Foresight:
    """Rolls out plans on the planning model, one at a time; close it when done."""

    def __init__(self, task: Task, episode: EpisodeConfig) -> None:
        """Predict for an episode; the task is compiled when the first plan is rolled out."""
        self._task, self._episode = task, episode
        self._engine: Engine | None = None
        self._unable = False

    def end_of(self, plan: Plan, tick: int, state: np.ndarray, memory: np.ndarray) -> np.ndarray:
        """States (T, nq + nv) from a tick's state to the plan's end.

        Empty if the rollout diverges, or if this machine cannot roll the task out.
        """
        nothing = np.empty((0, len(state)))
        engine = self._ready()
        until = plan.tick + round(plan.horizon / TICK)
        if engine is None or until <= tick:
            return nothing
        commands = self._task.actions.commands(plan.at(np.arange(tick, until)))
        ahead = engine.rollout(state, memory, commands[None])
        return ahead.states[0] if ahead.valid[0] else nothing

    def close(self) -> None:
        """Free the engine."""
        if self._engine is not None:
            self._engine.close()
            self._engine = None
        self._unable = True

    def _ready(self) -> Engine | None:
        if self._engine is None and not self._unable:
            self._unable = True  # tried once
            with suppress(SumoError):  # such as a policy that is not here: a view without ghost
                problem = Problem.build(self._task, planning_options(self._episode.planner))
                self._engine = problem.engine(1, self._episode.engine)
        return self._engine


class GhostLog:
    """Draws a plan's end: the moving bodies' visible geoms, translucent, and the base's way."""

    def __init__(self, out: Outputs, task: Task, model: mujoco.MjModel) -> None:
        """Sort the model's geoms by shape; the model is the plant's."""
        self._out, self._model = out, model
        self._base = model.body(task.scene.robot.base).id
        self._data = mujoco.MjData(model)
        moving = model.body_weldid[model.geom_bodyid] != 0
        seen = np.flatnonzero(moving & (model.geom_group < VISIBLE_GROUPS))
        self._geoms = {
            name: seen[np.isin(model.geom_type[seen], kinds)] for name, kinds in _KINDS.items()
        }

    def show(self, tick: int, states: np.ndarray) -> None:
        """Draw states (T, nq + nv) that begin at a tick; without any, nothing."""
        if not len(states):
            return
        shown = states[np.linspace(0, len(states) - 1, WAY_POINTS).round().astype(int)]
        way = np.array([self._at(state).xpos[self._base] for state in shown])
        way[:, 2] = ON_FLOOR
        strip = rr.LineStrips3D([way], colors=[GHOST], radii=rr.Radius.ui_points(2.0))
        self._out.log("world/plan/way", strip, tick=tick)
        for name, geoms in self._geoms.items():
            if len(geoms):
                self._out.log(f"world/plan/end/{name}", self._shapes(name, geoms), tick=tick)

    def _at(self, state: np.ndarray) -> mujoco.MjData:
        self._data.qpos[:] = state[: self._model.nq]
        mujoco.mj_kinematics(self._model, self._data)
        return self._data

    def _shapes(self, name: str, geoms: np.ndarray) -> rr.AsComponents:
        """Geoms of one shape where the simulation has them now."""
        size, centre = self._model.geom_size[geoms], self._data.geom_xpos[geoms]
        turn = self._data.geom_xmat[geoms].reshape(-1, 3, 3)
        look: dict[str, Any] = {"colors": [(*GHOST, 110)], "fill_mode": _FILL}
        look["quaternions"] = [_xyzw(matrix) for matrix in turn]
        if name == "capsules":
            start = centre - turn[:, :, 2] * size[:, 1:2]  # Rerun's capsules start at their origin
            return rr.Capsules3D(
                lengths=2 * size[:, 1], radii=size[:, 0], translations=start, **look
            )
        if name == "cylinders":
            return rr.Cylinders3D(lengths=2 * size[:, 1], radii=size[:, 0], centers=centre, **look)
        if name == "ellipsoids":
            round_ = self._model.geom_type[geoms, None] == _Geom.mjGEOM_SPHERE
            return rr.Ellipsoids3D(
                half_sizes=np.where(round_, size[:, :1], size), centers=centre, **look
            )
        bounds = self._model.geom_aabb[geoms]  # of a mesh, the box around it
        centre = centre + np.einsum("nij,nj->ni", turn, bounds[:, :3])
        return rr.Boxes3D(half_sizes=bounds[:, 3:], centers=centre, **look)


_KINDS = {
    "capsules": [_Geom.mjGEOM_CAPSULE],
    "cylinders": [_Geom.mjGEOM_CYLINDER],
    "ellipsoids": [_Geom.mjGEOM_SPHERE, _Geom.mjGEOM_ELLIPSOID],
    "boxes": [_Geom.mjGEOM_BOX, _Geom.mjGEOM_MESH],
}


def _xyzw(rotation: np.ndarray) -> np.ndarray:
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, rotation.ravel())
    return quat[[1, 2, 3, 0]]
