"""A compiled model in Rerun: its geometry once, then the poses of its bodies."""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
import rerun as rr

from sumo_dist.model.index import label
from sumo_dist.model.visible import drawn
from sumo_dist.view.about import legible
from sumo_dist.view.marks import Color
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.shapes import shape


@dataclass(frozen=True)
class Twin:
    """A translucent second one of all that moves in a scene.

    Attributes:
        root: of its entities.
        name: of what it is the twin of, for people.
        color: of it.
    """

    root: str
    name: str
    color: Color


class SceneLog:
    """Logs a model's visible geometry, then its bodies' poses in columnar chunks.

    Every drawn body is a named frame below the world; its geoms rest in that frame.
    """

    def __init__(
        self, out: Outputs, model: mujoco.MjModel, chunk_ticks: int, twin: Twin | None = None
    ) -> None:
        """Log the geometry; poses go out every `chunk_ticks` ticks and on flush.

        Args:
            out: where to write.
            model: of the scene.
            chunk_ticks: poses that are sent at a time.
            twin: log this one in place of the scene itself.
        """
        self._out, self._model = out, model
        self._chunk_ticks, self._color = chunk_ticks, None if twin is None else twin.color
        self._root = "world" if twin is None else twin.root
        geoms = np.flatnonzero(drawn(model))
        if twin is not None:
            geoms = geoms[model.body_weldid[model.geom_bodyid[geoms]] != 0]
        self._bodies = sorted({int(body) for body in model.geom_bodyid[geoms]} - {0})
        names = _names(model, "body", model.nbody)
        of = "" if twin is None else f"{twin.name} of "
        self._frames = {body: f"{of}{name}" for body, name in names.items()}
        self._geom_names = _names(model, "geom", model.ngeom)
        self._full_chunk_frames = self._child_frames(chunk_ticks)  # encoded once
        self._ticks: list[int] = []
        self._poses: list[np.ndarray] = []  # per tick, (bodies, 7)
        for geom in geoms:
            self._log_geom(int(geom))

    def add(self, tick: int, data: mujoco.MjData) -> None:
        """Take the poses of one tick; the data's kinematics are current."""
        self._ticks.append(tick)
        self._poses.append(np.hstack([data.xpos[self._bodies], data.xquat[self._bodies]]))
        if len(self._ticks) == self._chunk_ticks:
            self.flush()

    def flush(self) -> None:
        """Send the poses at hand, one row for each tick and body."""
        if not self._ticks or not self._bodies:
            return
        count = len(self._ticks)
        poses = np.concatenate(self._poses).astype(np.float32)
        moved = rr.Transform3D.columns(translation=poses[:, :3], quaternion=_xyzw(poses[:, 3:]))
        full = count == self._chunk_ticks
        frames = self._full_chunk_frames if full else self._child_frames(count)
        ticks = np.repeat(self._ticks, len(self._bodies))
        self._out.send(f"{self._root}/poses", ticks, [*moved, *frames])
        self._ticks, self._poses = [], []

    def _child_frames(self, ticks: int) -> rr.ComponentColumnList:
        names = [self._frames[body] for body in self._bodies]
        return rr.Transform3D.columns(child_frame=names * ticks)

    def _log_geom(self, geom: int) -> None:
        model = self._model
        found = shape(model, geom, self._color)
        if found is None:
            return
        body, name = int(model.geom_bodyid[geom]), self._geom_names[geom]
        archetype, offset = found
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        pose = rr.InstancePoses3D(
            translations=[model.geom_pos[geom] + rotation.reshape(3, 3) @ offset],
            quaternions=[_xyzw(model.geom_quat[geom])],
        )
        if body:
            frame = self._frames[body]
            path = [*self._root.split("/"), "bodies", frame, name]
            self._out.log(path, rr.CoordinateFrame(frame), pose, archetype)
        else:
            self._out.log([self._root, "fixed", name], pose, archetype)


def left_out(model: mujoco.MjModel) -> str:
    """Name what MuJoCo's own viewer shows of a model and this one does not; "" for nothing."""
    drawn_tendons = model.wrap_type != mujoco.mjtWrap.mjWRAP_JOINT
    counts = {
        "skin": model.nskin,
        "flexible body": model.nflex,
        "spatial tendon": sum(
            bool(drawn_tendons[first : first + count].any())
            for first, count in zip(model.tendon_adr, model.tendon_num, strict=True)
        ),
    }
    return ", ".join(f"{what} ({count})" for what, count in counts.items() if count)


def _names(model: mujoco.MjModel, kind: Literal["body", "geom"], count: int) -> dict[int, str]:
    """Name each element so that no two share a name: they would share a place in the viewer."""
    names: dict[int, str] = {}
    taken = set[str]()
    for i in range(count):
        name = legible(label(model, kind, i))
        while name in taken:
            name = f"{name}_{i}"
        names[i] = name
        taken.add(name)
    return names


def _xyzw(quat_wxyz: np.ndarray) -> np.ndarray:
    return quat_wxyz[..., [1, 2, 3, 0]]
