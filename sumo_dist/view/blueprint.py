"""The layout of the viewer: the scene, plots beside it, what it means and what happened below."""

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb

from sumo_dist.view.marks import eye_azimuth
from sumo_dist.view.outputs import TIMELINE

_ELEVATION = np.deg2rad(28.0)  # of the eye, seen from its target
_BACKGROUND = (18, 20, 25)


def layout(
    points: np.ndarray, movers: Sequence[str], goal: tuple[str, float] | None, distributed: bool
) -> rrb.Blueprint:
    """Arrange the views.

    Args:
        points: (N, 3) what the eye should take in at the start, the robot first, world [m].
        movers: what the robot moves.
        goal: what should come to the goal, and its distance at the start [m], if there is a goal.
        distributed: there are rollout workers to watch.
    """
    plots: list[rrb.View | rrb.Container] = [
        _plot("cost", "Cost of the candidate plans"),
        _plot("terms", "Cost terms of the current plan"),
        _plot("timing", "Planning time and plan age [ms]"),
    ]
    if goal is not None:
        name, distance = goal
        plots.insert(0, _plot("task", f"{name.capitalize()} to goal [m]", (0.0, 1.2 * distance)))
    if distributed:
        pace = _plot("pace", "Rollouts per second of each worker")
        plots.append(rrb.Tabs(_plot("workers", "Rollout workers"), pace))
    scene = rrb.TextDocumentView(origin="about/scene", name="What you see")
    cost = rrb.TextDocumentView(origin="about/cost", name="What a plan costs")
    columns = rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    events = rrb.TextLogView(origin="events", name="Events", columns=columns)
    left = rrb.Vertical(
        _scene(points, movers),
        rrb.Horizontal(scene, cost, events, column_shares=[5, 3, 4]),
        row_shares=[9, 4],
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*plots), column_shares=[5, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),  # a live run follows, a file plays
        auto_layout=False,
        auto_views=False,
    )


def _scene(points: np.ndarray, movers: Sequence[str]) -> rrb.Spatial3DView:
    eye, target = frame(points)
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


def frame(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return an eye (3,) and its target (3,) that show points (N, 3), the robot first [m]."""
    low, high = points.min(axis=0), points.max(axis=0)
    target = (low + high) / 2
    distance = 1.5 + 0.7 * float(np.linalg.norm(high - low))
    azimuth = np.deg2rad(eye_azimuth(points[0], target))
    direction = [
        np.cos(_ELEVATION) * np.cos(azimuth),
        np.cos(_ELEVATION) * np.sin(azimuth),
        np.sin(_ELEVATION),
    ]
    return target + distance * np.array(direction), target


def _plot(origin: str, name: str, span: tuple[float, float] | None = None) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"plots/{origin}",
        name=name,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
    )
