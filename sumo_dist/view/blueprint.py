"""The layouts of the viewer, a tab for each purpose: drive, tune, fleet, what it means."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from sumo_dist.view.about import legible
from sumo_dist.view.ahead import TERMS
from sumo_dist.view.charts import HEIGHT, MARGINS, WIDTH, Chart
from sumo_dist.view.outputs import TIMELINE
from sumo_dist.view.plots import AGE, Plot, Plots
from sumo_dist.view.search import KNOTS

Layout = Literal["drive", "tune", "fleet", "futures"]

PLOT_S = 6.0  # of robot time shown in plots, up to the cursor
LEGEND_S = 3.0  # left of it, where the legend is: as wide as some 20 letters
STATES_S = 10.0  # of robot time shown in lanes

_BACKGROUND = (18, 20, 25)


@dataclass(frozen=True)
class Eye:
    """From where the scene is looked at.

    Attributes:
        position, target: (3,) of the eye, and what is in the middle, world [m].
    """

    position: np.ndarray
    target: np.ndarray

    def above(self, way: np.ndarray) -> "Eye":
        """The same from above, with a way (2,) over the floor from left to right."""
        away = float(np.linalg.norm(self.position - self.target))
        aside = np.array([way[1], -way[0]]) / max(float(np.linalg.norm(way)), 1e-3)
        return Eye(self.target + away * np.array([*(0.1 * aside), 1.0]), self.target)


def layout(
    eye: Eye,
    above: Eye,
    movers: Sequence[str],
    plots: Plots,
    live: bool,
    first: Layout = "drive",
    also: Sequence[Plot] = (),
) -> rrb.Blueprint:
    """Arrange the views.

    Args:
        eye: from where the scene is looked at.
        above: from where its map is looked at.
        movers: what the robot moves.
        plots: that there are.
        live: the run goes on: the viewer follows it; else it plays from the start.
        first: which tab is open at first.
        also: plots of a tab before all others, which is open instead.
    """
    tabs = [_drive(eye, movers, plots), _tune(above, plots)]
    if plots.fleet:
        tabs.append(_fleet(plots))
    if also:
        tabs.insert(0, _futures(eye, movers, also))
        first = "futures"
    names = [str(tab.name) for tab in tabs]
    return rrb.Blueprint(
        rrb.Tabs(*tabs, _words(), active_tab=names.index(first) if first in names else 0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed", timeline=TIMELINE, play_state="following" if live else "playing"
        ),
        auto_layout=False,
        auto_views=False,
    )


def _drive(eye: Eye, movers: Sequence[str], plots: Plots) -> rrb.Vertical:
    """Is it late, does it get there, what does the robot do?"""
    shown = [*plots.progress[:3], AGE]
    return rrb.Vertical(
        _verdict(),
        _scene(eye, f"{', '.join(['Robot', *movers])} and candidate plans"),
        rrb.Horizontal(*[_plot(plot) for plot in shown]),
        _states("", "robot", "plans"),
        row_shares=[7, 62, 17, 15],
        name="drive",
    )


def _futures(eye: Eye, movers: Sequence[str], shown: Sequence[Plot]) -> rrb.Vertical:
    """How does another future do beside the recorded one?"""
    scene = _scene(eye, f"{', '.join(['Robot', *movers])}; red: as it was recorded")
    plots = rrb.Vertical(*[_plot(plot) for plot in shown])
    both = rrb.Horizontal(scene, plots, column_shares=[5, 3])
    return rrb.Vertical(_verdict(), both, row_shares=[7, 93], name="futures")


def _tune(above: Eye, plots: Plots) -> rrb.Vertical:
    """Is the cost wrong, does the search reach far enough, is the model right?"""
    terms, cost, off, forces = plots.tune
    left = rrb.Vertical(
        _chart(TERMS, "Cost along the newest plan"),
        _chart(KNOTS, "Its knots, and noise around them"),
        _scene(above, "From above: pale is planned", candidates=False),
        row_shares=[4, 4, 3],
    )
    right = rrb.Vertical(
        _plot(terms),
        _plot(cost),
        _plot(plots.progress[0]),
        _plot(off),
        _plot(forces),
        row_shares=[3, 3, 2, 3, 3],
    )
    return rrb.Vertical(_verdict(), rrb.Horizontal(left, right), row_shares=[7, 93], name="tune")


def _fleet(plots: Plots) -> rrb.Vertical:
    """Is a worker sick, is the optimizer or the network slow?"""
    timing, rollouts, pace, workers, dropped = plots.fleet
    left = rrb.Vertical(
        _states("What everybody does", "robot", "plans", "workers"),
        _plot(dropped),
        _events(),
        row_shares=[7, 3, 5],
    )
    right = rrb.Vertical(*[_plot(plot) for plot in (timing, rollouts, pace, workers)])
    return rrb.Vertical(_verdict(), rrb.Horizontal(left, right), row_shares=[7, 93], name="fleet")


def _words() -> rrb.Vertical:
    scene = rrb.TextDocumentView(origin="about/scene", name="What you see")
    cost = rrb.TextDocumentView(origin="about/cost", name="What a plan costs")
    return rrb.Vertical(
        _verdict(),
        rrb.Horizontal(scene, cost, column_shares=[3, 2]),
        _events(),
        row_shares=[7, 55, 38],
        name="what it means",
    )


def _verdict() -> rrb.TextDocumentView:
    return rrb.TextDocumentView(origin="verdict", name="How it goes", titlebar=False)


def _events() -> rrb.TextLogView:
    columns = rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    return rrb.TextLogView(origin="events", name="Events", columns=columns)


def _scene(eye: Eye, name: str, candidates: bool = True) -> rrb.Spatial3DView:
    without = [] if candidates else ["- /world/plan/samples", "- /world/plan/elites"]
    return rrb.Spatial3DView(
        origin="world",
        contents=["+ $origin/**", *without],
        name=legible(name),
        background=rrb.Background(kind=rrb.BackgroundKind.SolidColor, color=_BACKGROUND),
        line_grid=rrb.LineGrid3D(spacing=0.5, stroke_width=1.0, color=(255, 255, 255, 30)),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye.position,
            look_target=eye.target,
            eye_up=(0.0, 0.0, 1.0),
        ),
    )


def frame(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return a target (3,) and an eye's distance from it that show points (N, 3) [m]."""
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, 1.5 + 0.7 * float(np.linalg.norm(high - low))


def _chart(chart: Chart, name: str) -> rrb.Spatial2DView:
    left, right, above, below = MARGINS
    bounds = rrb.VisualBounds2D(x_range=(-left, WIDTH + right), y_range=(-above, HEIGHT + below))
    return rrb.Spatial2DView(origin=chart.origin, name=name, visual_bounds=bounds)


def _states(name: str, *lanes: str) -> rrb.StateTimelineView:
    return rrb.StateTimelineView(
        origin="/",
        contents=[f"+ /{lane}/**" for lane in lanes],
        name=name or None,
        titlebar=bool(name),
        time_view=rrb.TimeAxis(view_range=_until_now(STATES_S)),
    )


def _plot(plot: Plot) -> rrb.TimeSeriesView:
    """Show the last PLOT_S of a plot, beside them room for a legend: it covers nothing."""
    room = LEGEND_S if plot.legend else 0.0
    first = rr.TimeRangeBoundary.cursor_relative(seconds=-PLOT_S)
    now = rr.TimeRangeBoundary.cursor_relative()
    return rrb.TimeSeriesView(
        origin=f"plots/{plot.origin}",
        name=legible(plot.title),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=plot.legend),
        axis_x=rrb.TimeAxis(view_range=_until_now(PLOT_S + room)),
        time_ranges=[rrb.VisibleTimeRange(TIMELINE, start=first, end=now)],
    )


def _until_now(seconds: float) -> rr.TimeRange:
    return rr.TimeRange(
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-seconds),
        end=rr.TimeRangeBoundary.cursor_relative(),
    )
