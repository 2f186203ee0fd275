"""The layout of the viewer: the scene, plots beside it, what it means and what happened below."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from sumo_dist.view.about import legible
from sumo_dist.view.outputs import TIMELINE
from sumo_dist.view.plots import Plot

PLOT_S = 6.0  # of robot time shown in plots, up to the cursor
LEGEND_S = 3.0  # left of it, where the legend is: as wide as some 20 letters

_TITLE_AND_AXIS = 3  # height of a plot besides its legend, in lines of a legend
_BACKGROUND = (18, 20, 25)


def layout(
    eye: np.ndarray, target: np.ndarray, movers: Sequence[str], plots: Sequence[Plot], live: bool
) -> rrb.Blueprint:
    """Arrange the views.

    Args:
        eye, target: (3,) from where the scene is looked at, and what is in the middle, world [m].
        movers: what the robot moves.
        plots: from top to bottom; a plot is the higher the more lines its legend has.
        live: the run goes on: the viewer follows it; else it plays from the start.
    """
    verdict = rrb.TextDocumentView(origin="verdict", name="How it goes")
    scene = rrb.TextDocumentView(origin="about/scene", name="What you see")
    cost = rrb.TextDocumentView(origin="about/cost", name="What a plan costs")
    columns = rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    events = rrb.TextLogView(origin="events", name="Events", columns=columns)
    left = rrb.Vertical(
        verdict,
        _scene(eye, target, movers),
        rrb.Horizontal(scene, cost, events, column_shares=[5, 3, 4]),
        row_shares=[3, 18, 9],
    )
    rows: list[list[Plot]] = []
    for plot in plots:
        if plot.beside:
            rows[-1].append(plot)
        else:
            rows.append([plot])
    right = rrb.Vertical(
        *[rrb.Horizontal(*map(_plot, row)) if len(row) > 1 else _plot(row[0]) for row in rows],
        row_shares=[_TITLE_AND_AXIS + max(2, len(row[0].lines)) for row in rows],
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[5, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed", timeline=TIMELINE, play_state="following" if live else "playing"
        ),
        auto_layout=False,
        auto_views=False,
    )


def _scene(eye: np.ndarray, target: np.ndarray, movers: Sequence[str]) -> rrb.Spatial3DView:
    things = ", ".join(["Robot", *movers])
    return rrb.Spatial3DView(
        origin="world",
        name=f"{things} and candidate plans",
        background=rrb.Background(kind=rrb.BackgroundKind.SolidColor, color=_BACKGROUND),
        line_grid=rrb.LineGrid3D(spacing=0.5, stroke_width=1.0, color=(255, 255, 255, 30)),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)
        ),
    )


def frame(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return a target (3,) and an eye's distance from it that show points (N, 3) [m]."""
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, 1.5 + 0.7 * float(np.linalg.norm(high - low))


def _plot(plot: Plot) -> rrb.TimeSeriesView:
    """Show the last PLOT_S of a plot, beside them room for the legend: it covers nothing."""
    now = rr.TimeRangeBoundary.cursor_relative()
    left = rr.TimeRangeBoundary.cursor_relative(seconds=-PLOT_S - LEGEND_S)
    first = rr.TimeRangeBoundary.cursor_relative(seconds=-PLOT_S)
    return rrb.TimeSeriesView(
        origin=f"plots/{plot.origin}",
        name=legible(plot.title),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start=left, end=now)),
        time_ranges=[rrb.VisibleTimeRange(TIMELINE, start=first, end=now)],
    )
