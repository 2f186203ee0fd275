"""Charts over something else than the run's time, which Rerun's plots do not have: drawn in 2D.

A chart is a box of WIDTH x HEIGHT with lines in it; their names stand to its right.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from sumo_dist.view.about import legible
from sumo_dist.view.marks import Color
from sumo_dist.view.outputs import Outputs

WIDTH, HEIGHT = 210.0, 100.0
MARGINS = (22.0, 72.0, 8.0, 22.0)  # around the box: left, right, above, below; for the words

_WORDS = 15.0  # height of a name, so that no two stand on each other
_AXES: Color = (120, 126, 138)
_HAIR, _THIN, _BOLD = 0.5, 0.8, 1.4  # half the width of a line, in points of the screen


@dataclass(frozen=True)
class Curve:
    """One line of a chart.

    Attributes:
        name: beside its end, "" for none.
        x, y: (N,) its points.
        color: of line and name.
        spread: (N,) half of the height of a bar around each point; None for no bars.
        thin: it is less important than the others.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    color: Color
    spread: np.ndarray | None = None
    thin: bool = False


@dataclass(frozen=True)
class _Stroke:
    points: np.ndarray  # (N, 2)
    color: Color
    radius: float


@dataclass(frozen=True)
class _Word:
    at: tuple[float, float]
    text: str
    color: Color


@dataclass(frozen=True)
class Chart:
    """A chart.

    Attributes:
        origin: its entities are below.
        unit: of what is to the right.
    """

    origin: str
    unit: str

    def log(
        self,
        out: Outputs,
        tick: int,
        curves: Sequence[Curve],
        x_most: float,
        y_range: tuple[float, float],
    ) -> None:
        """Draw curves at a tick; what is beyond the axes, from 0 to x_most and y_range, is cut."""
        scale = _Scale(x_most, *y_range)
        strokes = [
            *_axes(scale),
            *(stroke for curve in curves for stroke in _strokes(curve, scale)),
        ]
        lines = rr.LineStrips2D(
            [stroke.points for stroke in strokes],
            colors=[stroke.color for stroke in strokes],
            radii=rr.Radius.ui_points([stroke.radius for stroke in strokes]),
        )
        words = [*_numbers(scale, self.unit), *_names(curves, scale)]
        points = rr.Points2D(
            [word.at for word in words],
            labels=[word.text for word in words],
            colors=[word.color for word in words],
            radii=rr.Radius.ui_points(_HAIR),
            show_labels=True,
        )
        out.log(f"{self.origin}/lines", lines, tick=tick)
        out.log(f"{self.origin}/words", points, tick=tick)


@dataclass(frozen=True)
class _Scale:
    x_most: float
    low: float
    high: float

    def place(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Put x and y (...) into the box, (..., 2); its y axis points down."""
        up = (np.clip(y, self.low, self.high) - self.low) / (self.high - self.low)
        return np.stack([x / self.x_most * WIDTH, (1.0 - up) * HEIGHT], axis=-1)


def _axes(scale: _Scale) -> list[_Stroke]:
    frame = np.array([[0.0, 0.0], [0.0, HEIGHT], [WIDTH, HEIGHT]])
    zero = scale.place(np.array([0.0, scale.x_most]), np.zeros(2))
    return [_Stroke(points, _AXES, _HAIR) for points in (frame, zero)]


def _strokes(curve: Curve, scale: _Scale) -> list[_Stroke]:
    line = scale.place(curve.x, curve.y)
    strokes = [_Stroke(line, curve.color, _HAIR if curve.thin else _BOLD)]
    if curve.spread is not None:
        ends = curve.y[:, None] + curve.spread[:, None] * [-1.0, 1.0]  # (N, 2)
        bars = scale.place(np.stack([curve.x, curve.x], axis=-1), ends)
        strokes += [_Stroke(bar, curve.color, _THIN) for bar in bars]
    return strokes


def _numbers(scale: _Scale, unit: str) -> list[_Word]:
    return [
        _Word((WIDTH - 12.0, HEIGHT + 11.0), f"{scale.x_most:.3g} {unit}", _AXES),
        _Word((-10.0, 0.0), f"{scale.high:.3g}", _AXES),
        _Word((-10.0, HEIGHT + 2.0), f"{scale.low:.3g}", _AXES),
    ]


def _names(curves: Sequence[Curve], scale: _Scale) -> list[_Word]:
    """Names beside the ends of the curves, in their order and not on each other."""
    ends = [(float(scale.place(c.x[-1:], c.y[-1:])[0, 1]), c) for c in curves if c.name]
    ends.sort(key=lambda end: end[0])
    heights = _spaced([height for height, _ in ends])
    return [
        _Word((WIDTH + 36.0, height), legible(curve.name), curve.color)
        for height, (_, curve) in zip(heights, ends, strict=True)
    ]


def _spaced(heights: Sequence[float]) -> list[float]:
    """Move ascending heights apart by _WORDS, upwards where there is no room below."""
    placed: list[float] = []
    for height in heights:
        placed.append(max(height, placed[-1] + _WORDS) if placed else height)
    limit = HEIGHT
    for i in reversed(range(len(placed))):
        placed[i] = min(placed[i], limit)
        limit = placed[i] - _WORDS
    return placed
