"""`sumo-dist bench estimator`: how far the estimated state is from the true one, by channel."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Annotated, Any

import tyro

from sumo_dist.bench.layout import Result, check_at_least, run_bench, table
from sumo_dist.bench.measure.walks import (
    SETTLE_S,
    VELOCITIES,
    Errors,
    Walk,
    mean_errors,
    title,
    walk,
)
from sumo_dist.errors import UsageError, unknown
from sumo_dist.estimate import LowPassConfig
from sumo_dist.plant.noise import NOMINAL, PLANTS
from sumo_dist.terminal import say

PROFILES = {"no noise": NOMINAL, "perturbed": PLANTS["perturbed"], "hard": PLANTS["hard"]}


@dataclass(frozen=True)
class Options:
    """Options of `bench estimator`.

    Attributes:
        json: print one JSON object.
        seeds: runs of each motion and profile.
        seconds: of each run.
        set: settings of the filters as key=value, such as linear_velocity_hz=8.
    """

    json: bool = False
    seeds: int = 3
    seconds: float = 5.0
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()

    def __post_init__(self) -> None:
        check_at_least(1, seeds=self.seeds)
        if not SETTLE_S < self.seconds <= 600:
            raise UsageError(f"seconds must be in ({SETTLE_S:g}, 600], got {self.seconds}")


def main(options: Options) -> int:
    """Walk under noise, on the estimate; print a table or one JSON object."""
    config = filters(options.set)
    run_bench("bench estimator", options.json, lambda: measure(options, config), text)
    return 0


def filters(settings: Iterable[str]) -> LowPassConfig:
    """Return the filters' settings, overridden by "key=value" texts."""
    names, changes = [field.name for field in fields(LowPassConfig)], {}
    for setting in settings:
        key, _, value = setting.partition("=")
        if key not in names:
            raise unknown("filter setting", key, names)
        try:
            changes[key] = float(value)
        except ValueError:
            raise UsageError(f"{key} needs a number, got {value!r}") from None
    return LowPassConfig(**changes)


def measure(options: Options, config: LowPassConfig) -> Result:
    """Walk under every noise profile."""
    rows = []
    for name, profile in PROFILES.items():
        for motion in VELOCITIES:
            walks = [
                walk(motion, profile, seed, options.seconds, config)
                for seed in range(options.seeds)
            ]
            rows.append({"profile": name, "motion": motion, **row(walks)})
            say(f"{name}, {motion}: done")
    about = {"filters": vars(config), "seeds": options.seeds, "seconds": options.seconds}
    return {**about, "rows": rows}


def row(walks: Sequence[Walk]) -> dict[str, Any]:
    """Return the root mean square errors over walks, and how the walks ended."""
    errors = [found for each in walks if (found := each.errors()) is not None]
    return {
        "walked": sum(not each.reason for each in walks),
        "runs": len(walks),
        "ended": sorted({each.reason for each in walks if each.reason}),
        "outliers": sum(each.outliers for each in walks),
        **mean_errors(errors)._asdict(),
    }


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    settings = ", ".join(f"{key} {value:g}" for key, value in result["filters"].items())
    yield (
        f"Spot walks {result['seconds']:g} s on the estimated state, {result['seeds']} seeds a "
        "row: straight into the box and pushing it (push), or turning away from it (turn). "
        "Root mean square of each channel's error vector, the first second left out. "
        f"Filters: {settings}."
    )
    columns = {"profile": "{profile}", "motion": "{motion}", "walked": "{walked}/{runs}"}
    channels = {title(channel): f"{{{channel}:.3g}}" for channel in Errors._fields}
    yield table({**columns, **channels}, result["rows"])
