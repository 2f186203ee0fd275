"""The picture of methods: success of each on each object. Needs the `bench` extra."""

from collections.abc import Sequence
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sumo_dist.bench.results.methods import METHODS, MOVE, OBJECTS, UPRIGHT, Outcome
from sumo_dist.bench.results.pictures import COLOURS, STYLE, svg

SPAN = 0.8  # of an object's bars together
INTERVAL = "#444444"
PUBLISHED: dict[str, Any] = {
    "linestyle": "none",
    "marker": "D",
    "markersize": 4,
    "color": "#222222",
    "markerfacecolor": "white",
}


def picture(outcomes: Sequence[Outcome]) -> str:
    """Return an SVG: a chart a family, with the rates here as bars and the paper's as marks."""
    with rc_context({**STYLE, "axes.grid.axis": "y", "axes.axisbelow": True}):
        figure = Figure((9.0, 3.2), layout="constrained")
        for axes, family in zip(figure.subplots(1, 2, sharey=True), (MOVE, UPRIGHT), strict=True):
            axes.set(title=f"{family.capitalize()}: success rate, 95 % interval", ylim=(0.0, 1.04))
            axes.set_xticks(range(len(OBJECTS)), OBJECTS)
            width = SPAN / len(outcomes)
            for i, found in enumerate(outcomes):
                _draw(axes, found, family, (i + 0.5) * width - SPAN / 2, width)
        axes = figure.axes[0]
        axes.plot([], [], label="the paper's rate of it", **PUBLISHED)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=5)
        return svg(figure)


def _draw(axes: Axes, found: Outcome, family: str, shift: float, width: float) -> None:
    """Draw a method's bars with Wilson's intervals, and its published rates."""
    drawn = [(x, found.counts.get((family, thing))) for x, thing in enumerate(OBJECTS)]
    counts = {x + shift: count for x, count in drawn if count is not None}
    places, rates = [*counts], [count.rate for count in counts.values()]
    colour = COLOURS[[*METHODS].index(found.method.name)]
    axes.bar(places, rates, 0.9 * width, color=colour, label=found.method.title)
    for place, count in counts.items():
        axes.vlines(place, *count.interval, color=INTERVAL, linewidth=1)
    published = [found.method.published[family][x] for x, count in drawn if count is not None]
    axes.plot(places, published, **PUBLISHED)
