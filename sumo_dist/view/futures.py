"""Another future of the same run beside the one that is shown: a twin, its way, and its costs."""

from collections.abc import Sequence

import mujoco
import numpy as np
import rerun as rr

from sumo_dist.record.recording import Recording
from sumo_dist.record.world import World
from sumo_dist.view.marks import ON_FLOOR, RECORDED, Color
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.plots import Plot
from sumo_dist.view.scene import SceneLog, Twin
from sumo_dist.view.ways import ways

TWIN_TICKS = 5  # of robot time between two poses of the twin
_WAY_TICKS = 25  # between points of its way
_NEW: Color = (66, 146, 214)
_LINES = ("what if", "recorded")
_TWIN = Twin("world/recorded", "recorded", RECORDED)


def plots_of(recording: Recording) -> tuple[Plot, ...]:
    """Return the plots that compare two futures: the whole cost, and each term."""
    terms = (
        Plot(f"futures/{i}", f"Cost: {name}", _LINES)
        for i, name in enumerate(recording.config["terms"])
    )
    return Plot("futures/whole", "Cost of the plan: what if and recorded", _LINES), *terms


class OtherFuture:
    """Draws the recorded future into a run that has branched off it."""

    def __init__(
        self, out: Outputs, world: World, run: Recording, other: Recording, tick: int
    ) -> None:
        """Compare a run with another one that was the same up to a tick."""
        self._out, self._states, self._tick = out, other.states, tick
        self._model, self._data = world.model, mujoco.MjData(world.model)
        self._twin = SceneLog(out, world.model, chunk_ticks=1, twin=_TWIN)
        self._ways = ways(world, list(other.states[tick:]))
        for plot in plots_of(run):
            look = rr.SeriesLines(names=plot.lines, colors=[_NEW, RECORDED])
            out.log(f"plots/{plot.origin}", look)
        self._log_costs(run, other)

    def log(self, tick: int) -> None:
        """Draw the other future at a tick; after its end it stays as it ended.

        Until they part, the twin is where the robot is.
        """
        if tick % TWIN_TICKS or tick >= len(self._states) + TWIN_TICKS:
            return
        at = min(tick, len(self._states) - 1)
        self._data.qpos[:] = self._states[at][: self._model.nq]
        mujoco.mj_kinematics(self._model, self._data)
        self._twin.add(tick, self._data)
        if tick < self._tick:
            return
        for name, way in self._ways.items():
            points = way[: at - self._tick + 1 : _WAY_TICKS] * [1, 1, 0] + [0, 0, ON_FLOOR]
            strip = rr.LineStrips3D([points], colors=[RECORDED], radii=rr.Radius.ui_points(2.0))
            self._out.log(f"world/recorded/trail/{name}", strip, tick=tick)

    def _log_costs(self, run: Recording, other: Recording) -> None:
        """Plot both futures' costs: of the candidate without noise, each at its own weights."""
        ticks, columns = merged(run, other, self._tick)
        for origin, pair in zip((plot.origin for plot in plots_of(run)), columns, strict=True):
            scalars = rr.Scalars.columns(scalars=pair.ravel()).partition([2] * len(ticks))
            self._out.send(f"plots/{origin}", ticks, scalars)


def merged(run: Recording, other: Recording, tick: int) -> tuple[np.ndarray, Sequence[np.ndarray]]:
    """Return the ticks from one on at which both or one planned, and the costs there.

    Returns:
        Ticks (n,), and for the whole cost and each term (n, 2): of the run and of the other, nan
        where it has no plan.
    """
    mine, theirs = np.asarray(run.plan_ticks), np.asarray(other.plan_ticks)
    ticks = np.union1d(mine, theirs)
    ticks = ticks[ticks >= tick]
    costs = np.full((len(ticks), 2, 1 + len(run.config["terms"])), np.nan)
    for column, (recording, planned) in enumerate(((run, mine), (other, theirs))):
        later = planned >= tick
        if later.any():
            terms = np.array(recording.terms)[later]
            rows = np.searchsorted(ticks, planned[later])
            costs[rows, column] = np.column_stack([terms.sum(axis=1), terms])
    return ticks, [costs[:, :, i] for i in range(costs.shape[2])]
