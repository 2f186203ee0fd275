"""The picture of searches: success, and the loss, against CPU hours. Needs the `tune` extra."""

from collections.abc import Callable, Sequence

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sumo_dist.bench.results.pictures import COLOURS, STYLE, svg
from sumo_dist.bench.tune.report import HOUR, Found
from sumo_dist.bench.tune.results import COMPLETE, RUNNING, Tried


def picture(searches: Sequence[Found]) -> str:
    """Return an SVG: the best success rate and loss until each time, and each trial's as a dot."""
    with rc_context(STYLE):
        figure = Figure((9.0, 3.0), layout="constrained")
        success, losses = figure.subplots(1, 2)
        for i, found in enumerate(searches):
            colour, name = COLOURS[i % len(COLOURS)], f"seed {found.request['decides']['seed']}"
            _draw(success, found, lambda t: t.solved / len(t.rows), max, colour, name)
            _draw(losses, found, lambda t: t.loss, min, colour, name)
        success.set(title="success of the best trial until then", ylim=(-0.04, 1.04))
        losses.set(title="least loss until then; dots are trials, hollow ones pruned")
        for axes in (success, losses):
            axes.set(xscale="log", xlabel="CPU time [h]")
        if len(searches) > 1:
            success.legend(loc="lower right")
        return svg(figure)


def _draw(
    axes: Axes,
    found: Found,
    value: Callable[[Tried], float],
    better: Callable[[float, float], float],
    colour: str,
    name: str,
) -> None:
    """Draw the trials that have ended, and the best of the complete ones until each time."""
    times, values = list[float](), list[float]()
    for trial in sorted(found.trials, key=lambda trial: trial.cpu_s):
        if trial.state == RUNNING:
            continue
        here, is_complete = trial.cpu_s / HOUR, trial.state == COMPLETE
        axes.plot(
            here,
            value(trial),
            "o",
            color=colour,
            markersize=3,
            alpha=0.5,
            fillstyle="full" if is_complete else "none",
        )
        if is_complete:
            times.append(here)
            values.append(better(values[-1], value(trial)) if values else value(trial))
    if times:
        end = max(trial.cpu_s for trial in found.trials) / HOUR
        axes.step([*times, end], [*values, values[-1]], where="post", color=colour, label=name)
