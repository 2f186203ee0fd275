"""The ways so far: of robot and objects over the floor, and of a gripper through the air."""

from collections import deque

import numpy as np
import rerun as rr

from sumo_dist.costs.view import View
from sumo_dist.tasks.task import Task
from sumo_dist.view.marks import LIMB, ON_FLOOR, way_colors
from sumo_dist.view.outputs import Outputs

TRAIL_TICKS = 25  # of robot time between points over the floor
TRAIL_POINTS = 120  # of these: the last minute
AIR_TICKS = 5  # of robot time between points in the air
AIR_POINTS = 40  # of these: the last four seconds


class TrailLog:
    """Draws the ways so far."""

    def __init__(self, out: Outputs, task: Task) -> None:
        """Start with none."""
        self._out = out
        self._colors = way_colors(task)
        self._floor = {name: deque[np.ndarray](maxlen=TRAIL_POINTS) for name in self._colors}
        limbs = [name for name in task.trails if name not in self._colors]
        self._air = {name: deque[np.ndarray](maxlen=AIR_POINTS) for name in limbs}
        self._next_floor = self._next_air = 0

    @property
    def names(self) -> tuple[str, ...]:
        """Frames with a way over the floor, the robot's first."""
        return tuple(self._floor)

    def extend(self, tick: int, view: View) -> None:
        """Go on to where everything is at a tick."""
        if tick >= self._next_floor:
            self._next_floor = tick + TRAIL_TICKS
            for name, trail in self._floor.items():
                trail.append(np.append(view[name].pos[0, 0, :2], ON_FLOOR))
                self._log(name, trail, tick)
        if tick >= self._next_air:
            self._next_air = tick + AIR_TICKS
            for name, trail in self._air.items():
                trail.append(view[name].pos[0, 0].copy())
                self._log(name, trail, tick)

    def _log(self, name: str, trail: deque[np.ndarray], tick: int) -> None:
        color, radius = self._colors.get(name, LIMB), rr.Radius.ui_points(2.0)
        strip = rr.LineStrips3D([np.array(trail)], colors=[color], radii=radius)
        self._out.log(f"world/trail/{name}", strip, tick=tick)
