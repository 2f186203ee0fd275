"""Compare cut-offs of the low-pass filters: lag on one side, noise on the other.

First on the same walks: the policy walks on the true state while the sensors are recorded, and
every value filters these recordings, so that the values differ in nothing else. Then each value
walks on its own estimates: the policy answers to lag and noise, and what it does is estimated next.
"""

import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from typing import Any

from sumo_dist.bench.layout import heading, markdown
from sumo_dist.bench.measure.channels import Errors, mean_errors, title
from sumo_dist.bench.measure.walks import VELOCITIES, Walk, walk
from sumo_dist.errors import UsageError, unknown
from sumo_dist.estimate import LowPassConfig, LowPassEstimator
from sumo_dist.plant.noise import NOMINAL, PLANTS, PlantProfile

_HARD = PLANTS["hard"]
PROFILES = {
    "no noise": NOMINAL,
    "perturbed": PLANTS["perturbed"],
    "hard": _HARD,
    "harder": replace(  # sensors half as bad again: here it falls
        _HARD,
        encoder_rad=1.5 * _HARD.encoder_rad,
        encoder_rad_s=1.5 * _HARD.encoder_rad_s,
        mocap_m=1.5 * _HARD.mocap_m,
        mocap_rad=1.5 * _HARD.mocap_rad,
        mocap_delay_ms=_HARD.mocap_delay_ms * 3 // 2,
        mocap_drop=1.5 * _HARD.mocap_drop,
        mocap_gap=1.5 * _HARD.mocap_gap,
        mocap_outlier=1.5 * _HARD.mocap_outlier,
    ),
}
INFLUENCES = {  # cut-off -> channels; a pose moves on by its filtered velocity
    "joint_position_hz": ("joints_mrad",),
    "joint_velocity_hz": ("joints_rad_s", "joints_mrad"),
    "position_hz": ("base_mm", "box_mm"),
    "rotation_hz": ("base_mrad", "box_mrad"),
    "linear_velocity_hz": ("base_m_s", "base_mm", "box_m_s", "box_mm"),
    "angular_velocity_hz": ("base_rad_s", "base_mrad", "box_rad_s", "box_mrad"),
}


@dataclass(frozen=True)
class Values:
    """Values of one cut-off to compare.

    Attributes:
        setting: which cut-off.
        chosen: its value without the sweep [Hz].
        configs: the filters' settings with each value [Hz], ascending.
    """

    setting: str
    chosen: float
    configs: dict[float, LowPassConfig]


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


def values(sweep: str, settings: Sequence[str]) -> Values:
    """Read "key=value,value,..."; the value that holds without the sweep is always among them.

    Args:
        sweep: the text.
        settings: "key=value" texts for the other settings.

    Raises:
        UsageError: there is no such cut-off, or a value is not a positive number.
    """
    key, _, listed = sweep.partition("=")
    if key not in INFLUENCES:
        raise unknown("cut-off", key, INFLUENCES)
    without = filters(settings)
    configs = [without, *(filters([*settings, f"{key}={value}"]) for value in listed.split(","))]
    by_value = {getattr(config, key): config for config in configs}
    return Values(key, getattr(without, key), dict(sorted(by_value.items())))


def sweep(swept: Sequence[Values], seeds: int, seconds: float) -> list[dict[str, Any]]:
    """Return a row for each cut-off, profile and motion; see `compare`."""
    rows = []
    for name, profile in PROFILES.items():
        for motion in VELOCITIES:
            walks = cache(partial(_walks, motion, profile, seeds, seconds))
            about = {"profile": name, "motion": motion, "runs": seeds}
            rows += [{**about, **compare(values, walks)} for values in swept]
            print(f"{name}, {motion}: done", file=sys.stderr, flush=True)
    return rows


def compare(
    values: Values, walks: Callable[[LowPassConfig | None], Sequence[Walk]]
) -> dict[str, Any]:
    """Return what the channels that a cut-off influences are off, lists over its values.

    Args:
        values: of the cut-off.
        walks: makes walks on the estimates of a filter, or on the true state.

    Returns:
        "same": by channel, on the walks on the true state; "own": on the value's own walks;
        "walked": how many of these went to the end.
    """
    same, own = walks(None), [walks(config) for config in values.configs.values()]
    on_same = [
        mean_errors(each.errors(each.replay(LowPassEstimator(each.model, config))) for each in same)
        for config in values.configs.values()
    ]
    on_own = [mean_errors(each.errors(each.estimates) for each in walked) for walked in own]
    return {
        "setting": values.setting,
        "chosen": values.chosen,
        "values": list(values.configs),
        "walked": [sum(not each.reason for each in walked) for walked in own],
        "same": _by_channel(on_same, values.setting),
        "own": _by_channel(on_own, values.setting),
    }


def text(result: dict[str, Any]) -> str:
    """Lay out what was compared, two tables for each cut-off."""
    others = ", ".join(f"{key} {value:g}" for key, value in result["filters"].items())
    parts = [
        heading("bench estimator --sweep", result),
        f"Spot walks {result['seconds']:g} s, {result['seeds']} seeds a profile and motion: "
        "straight into the box and pushing it (push), or turning away from it (turn). Same walks: "
        "on the true state; every value [Hz] filters the sensors recorded there. Own walks: each "
        "value walks on its own estimates. Root mean square of each channel's error vector, the "
        "first second left out; the best of a row is bold, the present value marked *. Harder is "
        "the hard plant with sensors half as bad again. Filters but for the swept value: "
        f"{others}.",
    ]
    for setting in dict.fromkeys(row["setting"] for row in result["rows"]):
        rows = [row for row in result["rows"] if row["setting"] == setting]
        same, own = _table(rows, "same"), _table(rows, "own")
        parts += [f"## {setting}", "Same walks:", same, "Own walks:", own]
    return "\n\n".join(parts)


def _walks(
    motion: str, profile: PlantProfile, seeds: int, seconds: float, config: LowPassConfig | None
) -> list[Walk]:
    return [walk(motion, profile, seed, seconds, config) for seed in range(seeds)]


def _by_channel(errors: Sequence[Errors], setting: str) -> dict[str, list[float]]:
    return {channel: [getattr(each, channel) for each in errors] for channel in INFLUENCES[setting]}


def _table(rows: Sequence[dict[str, Any]], walks: str) -> str:
    """One cut-off: a line for each channel, profile and motion, a column for each value."""
    first = rows[0]
    marked = (f"{value:g}{'*' if value == first['chosen'] else ''}" for value in first["values"])
    counts = [
        ("walked", row["profile"], row["motion"], *(f"{n}/{row['runs']}" for n in row["walked"]))
        for row in rows
    ]
    lines = [
        (title(channel), row["profile"], row["motion"], *_bold_best(row[walks][channel]))
        for channel in INFLUENCES[first["setting"]]
        for row in rows
    ]
    lines = lines if walks == "same" else [*counts, *lines]
    return markdown(("channel", "profile", "motion", *marked), lines)


def _bold_best(errors: Sequence[float]) -> list[str]:
    texts, best = [f"{error:.3g}" for error in errors], f"{min(errors):.3g}"
    alike = len(set(texts)) == 1
    return [f"**{each}**" if each == best and not alike else each for each in texts]
