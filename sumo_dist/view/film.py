"""The processes that draw a recording as a film; see replay.render."""

import multiprocessing
import os
import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import imageio.v2 as imageio
import mujoco
import numpy as np
from numpy.typing import ArrayLike

from sumo_dist.provenance import cores
from sumo_dist.record.recording import Recording
from sumo_dist.record.world import World
from sumo_dist.timing import TICK
from sumo_dist.view.eye import Shot, clearest_azimuth
from sumo_dist.view.marks import (
    ELITE,
    GOAL,
    ON_FLOOR,
    RECORDED,
    SHOWN,
    TRACE_POINTS,
    eye_azimuth,
    goal_rings,
    ranked,
    thinned,
    way_colors,
)
from sumo_dist.view.replay import NO_GRAPHICS, STRIP, episode
from sumo_dist.view.ways import ways

FPS = {".mp4": 25.0, ".gif": 12.5, ".webp": 12.5}  # at most one frame a tick
_SMALL = 640, 360
SIZE = {
    ".mp4": (960, 544),
    ".gif": _SMALL,
    ".webp": _SMALL,
    ".jpg": (560, 350),
}  # [pixels], halved in strips

_FOLLOW_S = 3.0  # the camera's path is averaged over this long
_ELEVATION = -24.0  # of the line of sight [deg]
_SHOTS = 12  # of the run that the camera's side is chosen by
_SHADOW_REACH = 4.5  # of the camera's surroundings, in extents of the model
_LIGHT_AWAY = 2.0  # of lights from what is looked at: further off, the far floor is speckled [m]
_SHADOW_PIXELS = 4096  # across them, 7 mm each
_SAMPLES = 2  # of each pixel; twice as many take a third longer
_AHEAD = 4  # frames that each process may have drawn before they are written

_TRAIL_TICKS = 10  # between points of a trail

_LIGHT = 1.6  # how bright the scene's lights make a line
_LINE = mujoco.mjtGeom.mjGEOM_LINE


class _Artist:
    """Draws ticks of a recording."""

    def __init__(self, reel: "_Reel", size: tuple[int, int]) -> None:
        """Open an offscreen renderer of (width, height) pixels."""
        recording = self._recording = reel.recording
        world = World.of(recording)
        task = world.task
        self._colors = way_colors(task)
        table = task.table
        plans = recording.parameters or [episode(recording).cost(task).parameters]
        self._goals = [task.goal_position(table.named(numbers)) for numbers in plans]
        self._model = world.model
        self._model.vis.quality.shadowsize = _SHADOW_PIXELS
        self._model.vis.quality.offsamples = _SAMPLES
        self._model.vis.map.shadowclip = _SHADOW_REACH
        self._data = mujoco.MjData(self._model)
        self._renderer = mujoco.Renderer(self._model, width=size[0], height=size[1])
        self._trails = ways(world, recording.states)
        self._other, self._parts = reel.other, reel.ticks.start
        others = {} if self._other is None else ways(world, self._other.states)
        self._others = {name: way[self._parts :] for name, way in others.items()}
        seen = [_held(way, reel.ticks.stop) for way in (*self._trails.values(), *others.values())]
        self._lookat, self._distance = _camera_path(seen, self._goals[0])
        self._camera = mujoco.MjvCamera()
        self._camera.azimuth = self._clearest_side(task.scene.robot.base) + 180.0
        self._camera.elevation = _ELEVATION
        self._planner = episode(recording).planner
        ticks = np.arange(reel.ticks.stop)
        self._plans = np.searchsorted(recording.plan_ticks, ticks, side="right") - 1  # followed

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()

    def _clearest_side(self, base: str) -> float:
        robot, states = next(iter(self._trails.values()))[0], self._recording.states
        ticks = thinned(len(states), _SHOTS)
        shots = [
            Shot(states[tick][: self._model.nq], self._lookat[tick], self._distance[tick])
            for tick in map(int, ticks)
        ]
        preferred = eye_azimuth(robot, self._lookat[0])
        return clearest_azimuth(self._model, base, shots, -_ELEVATION, preferred)

    def draw(self, tick: int) -> np.ndarray:
        """Return the picture at a tick, (height, width, 3) uint8."""
        self._pose(self._recording, tick)
        self._camera.lookat[:] = self._lookat[tick]
        self._camera.distance = self._distance[tick]
        self._renderer.update_scene(self._data, self._camera)
        self._follow_with_lights()
        goal = self._goals[max(0, self._plans[tick])]
        if goal is not None:
            for ring in goal_rings(goal):
                self._draw_line(ring, GOAL, 3.0)
        for name, path in self._trails.items():
            self._draw_way(path[: tick + 1], self._colors[name])
        if self._plans[tick] >= 0 and self._recording.seen(int(self._plans[tick])):
            self._draw_candidates(self._plans[tick])
        if self._other is not None:
            self._pose(self._other, tick)
            _add_twin(self._model, self._data, self._renderer.scene)
            for path in self._others.values():
                self._draw_way(path[: tick - self._parts + 1], RECORDED)
        return self._renderer.render()

    def _pose(self, recording: Recording, tick: int) -> None:
        """Put the model where a recording has it; after its end it stays."""
        at = min(tick, len(recording.states) - 1)
        self._data.qpos[:] = recording.states[at][: self._model.nq]
        mujoco.mj_fwdPosition(self._model, self._data)

    def _follow_with_lights(self) -> None:
        """Move the lights along: shadows are drawn around a light's place, sharper the nearer."""
        scene = self._renderer.scene
        for light in scene.lights[: scene.nlight]:
            light.pos = self._camera.lookat - _LIGHT_AWAY * np.array(light.dir)

    def _draw_candidates(self, plan: int) -> None:
        traces = self._recording.traces[plan]
        elites, others, shades = ranked(self._recording.costs[plan], self._planner)
        points = thinned(traces.shape[2], TRACE_POINTS)
        for i in thinned(len(others), SHOWN):
            for path in traces[others[i]][:, points]:
                self._draw_line(path, shades[i], 1.5)
        for path in traces[elites].reshape(-1, *traces.shape[2:]):
            self._draw_line(path, ELITE, 3.0)

    def _draw_way(self, path: np.ndarray, color: ArrayLike) -> None:
        """Draw a way (ticks, 3) on the floor below it."""
        self._draw_line(path[::_TRAIL_TICKS] * [1, 1, 0] + [0, 0, ON_FLOOR], color, 4.0)

    def _draw_line(self, points: np.ndarray, color: ArrayLike, width: float) -> None:
        """Draw a line through (P, 3), `width` pixels wide, as far as the picture can hold it."""
        scene = self._renderer.scene
        rgba = np.append(np.asarray(color) / 255 / _LIGHT, 1.0).astype(np.float32)
        for start, end in pairwise(points):
            if scene.ngeom >= scene.maxgeom:
                return
            geom = scene.geoms[scene.ngeom]
            mujoco.mjv_initGeom(geom, _LINE, np.zeros(3), np.zeros(3), np.eye(3).ravel(), rgba)
            mujoco.mjv_connector(geom, _LINE, width, start, end)
            scene.ngeom += 1


def _add_twin(model: mujoco.MjModel, data: mujoco.MjData, scene: mujoco.MjvScene) -> None:
    """Add what moves to a scene of MuJoCo's renderer, translucent, as data's kinematics have it."""
    first = scene.ngeom
    mujoco.mjv_addGeoms(
        *(model, data, mujoco.MjvOption(), mujoco.MjvPerturb()),
        int(mujoco.mjtCatBit.mjCAT_DYNAMIC),
        scene,
    )
    for geom in scene.geoms[first : scene.ngeom]:
        geom.rgba = np.append(np.array(RECORDED, np.float32) / 255, 0.4)


def _held(path: np.ndarray, length: int) -> np.ndarray:
    """Let a path (ticks, 3) stay where it ends, up to a length."""
    return np.concatenate([path, np.repeat(path[-1:], max(0, length - len(path)), axis=0)])


def _camera_path(paths: list[np.ndarray], goal: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return what the camera looks at, (ticks, 3), and from how far, (ticks,) [m].

    It follows what moves, calmly, and keeps the goal in the picture.
    """
    seen = np.stack(paths if goal is None else [*paths, np.broadcast_to(goal, paths[0].shape)])
    low, high = seen.min(axis=0), seen.max(axis=0)
    span = np.linalg.norm(high - low, axis=1, keepdims=True)
    return _smoothed((low + high) / 2), _smoothed(1.9 + 0.75 * span)[:, 0]


def _smoothed(path: np.ndarray) -> np.ndarray:
    """Average (ticks, n) over _FOLLOW_S around each tick."""
    half = round(_FOLLOW_S / TICK / 2)
    padded = np.pad(path, ((half + 1, half), (0, 0)), mode="edge")
    sums = np.cumsum(padded, axis=0)
    return (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)


_SETTINGS: dict[str, dict[str, Any]] = {
    ".mp4": {"quality": 7},
    ".gif": {"loop": 0},
    ".webp": {"loop": 0, "quality": 25, "method": 6},
}
_artists: list[_Artist] = []  # the one of a process that draws some of the frames


class _Reel(NamedTuple):
    """What a film shows.

    Attributes:
        recording: the run.
        other: another future of it, or None.
        ticks: that are shown: from where they part to the end of the longer one, or all.
    """

    recording: Recording
    other: Recording | None
    ticks: range


def _reel(words: Sequence[str]) -> _Reel:
    """Load a recording, and another future and the tick where they part, if those are named."""
    recording = Recording.load(words[0])
    if len(words) == 1:
        return _Reel(recording, None, range(len(recording.states)))
    other, tick = Recording.load(words[1]), int(words[2])
    return _Reel(recording, other, range(tick, max(len(recording.states), len(other.states))))


def _hire(words: Sequence[str], size: tuple[int, int]) -> None:
    _artists.append(_Artist(_reel(words), size))


def _drawn(tick: int) -> np.ndarray:
    return _artists[0].draw(tick)


def _frames(
    words: Sequence[str], size: tuple[int, int], ticks: Sequence[int]
) -> Iterator[np.ndarray]:
    """Yield the pictures at some ticks, (height, width, 3) uint8, drawn by a process a core."""
    os.environ["LP_NUM_THREADS"] = "1"  # of Mesa's renderer on the CPU: the cores are taken
    workers = max(1, min(cores(), len(ticks) // _AHEAD))
    with multiprocessing.get_context("spawn").Pool(workers, _hire, (words, size)) as pool:
        room = multiprocessing.BoundedSemaphore(workers * _AHEAD)

        def admitted() -> Iterator[int]:
            for tick in ticks:
                room.acquire()
                yield tick

        for picture in pool.imap(_drawn, admitted()):
            room.release()
            yield picture


def _draw_film(path: Path, words: Sequence[str]) -> int:
    """Draw a recording; the exit code is NO_GRAPHICS if there is nothing to draw with."""
    reel = _reel(words)
    try:
        artist = _Artist(reel, SIZE[path.suffix])
    except Exception as error:  # every graphics library fails in its own way
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
        return NO_GRAPHICS
    if path.suffix == ".jpg":
        imageio.imwrite(path, _strip(artist, reel.ticks), quality=70)
        return 0
    artist.close()
    ticks = reel.ticks[:: round(1 / TICK / FPS[path.suffix])]
    writer: Any = imageio.get_writer(path, fps=FPS[path.suffix], **_SETTINGS[path.suffix])
    with writer as film:
        for i, picture in enumerate(_frames(words, SIZE[path.suffix], ticks)):
            film.append_data(picture)
            if i % 100 == 99:
                sys.stdout.write(f"frame {i + 1} of {len(ticks)}\n")
                sys.stdout.flush()
    return 0


def _strip(artist: _Artist, ticks: range) -> np.ndarray:
    """Draw pictures from start to end, side by side, (height, STRIP * width, 3) uint8."""
    at = np.linspace(ticks[0], ticks[-1], STRIP).round().astype(int)
    strip = np.hstack([artist.draw(int(tick)) for tick in at])
    height, width, _ = strip.shape
    return strip.reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3)).round().astype("u1")


if __name__ == "__main__":
    sys.exit(_draw_film(Path(sys.argv[2]), (sys.argv[1], *sys.argv[3:])))
