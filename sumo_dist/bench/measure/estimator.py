"""`sumo-dist bench estimator`: how far the estimated state is from the true one, by channel."""

import json
import sys
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import tyro

from sumo_dist.bench.layout import heading, markdown
from sumo_dist.bench.measure import cutoffs
from sumo_dist.bench.measure.channels import Errors, mean_errors, title
from sumo_dist.bench.measure.walks import SETTLE_S, VELOCITIES, Newest, Walk, walk
from sumo_dist.errors import UsageError
from sumo_dist.estimate import LowPassConfig
from sumo_dist.plant.noise import NOMINAL, PLANTS, PlantProfile
from sumo_dist.provenance import timing_provenance

_HARD = PLANTS["hard"]
PROFILES: dict[str, PlantProfile] = {
    "no noise": NOMINAL,
    "encoder noise": replace(
        NOMINAL, encoder_rad=_HARD.encoder_rad, encoder_rad_s=_HARD.encoder_rad_s
    ),
    "mocap noise": replace(NOMINAL, mocap_m=_HARD.mocap_m, mocap_rad=_HARD.mocap_rad),
    "mocap delay": replace(NOMINAL, mocap_delay_ms=_HARD.mocap_delay_ms),
    "mocap dropouts": replace(
        NOMINAL,
        mocap_drop=_HARD.mocap_drop,
        mocap_gap=_HARD.mocap_gap,
        mocap_gap_ms=_HARD.mocap_gap_ms,
    ),
    "mocap outliers": replace(NOMINAL, mocap_outlier=_HARD.mocap_outlier),
    "perturbed": PLANTS["perturbed"],
    "hard": PLANTS["hard"],
}
DELAYED = "mocap delay"


@dataclass(frozen=True)
class Options:
    """Options of `bench estimator`.

    Attributes:
        json: print one JSON object.
        seeds: runs of each motion and profile.
        seconds: of each run.
        set: settings of the filters as key=value, such as linear_velocity_hz=8.
        sweep: compare values of a cut-off, such as linear_velocity_hz=4,8,16.
    """

    json: bool = False
    seeds: int = 3
    seconds: float = 5.0
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    sweep: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()

    def __post_init__(self) -> None:
        if self.seeds < 1:
            raise UsageError(f"seeds must be at least 1, got {self.seeds}")
        if not SETTLE_S < self.seconds <= 600:
            raise UsageError(f"seconds must be in ({SETTLE_S:g}, 600], got {self.seconds}")


def main(options: Options) -> int:
    """Walk under noise, on the estimate or to sweep; print tables or one JSON object."""
    config = cutoffs.filters(options.set)
    swept = [cutoffs.values(sweep, options.set) for sweep in options.sweep]
    about = {**timing_provenance(), "filters": vars(config)}
    about = {**about, "seeds": options.seeds, "seconds": options.seconds}
    if swept:
        rows = cutoffs.sweep(swept, options.seeds, options.seconds)
    else:
        rows = measure(config, options.seeds, options.seconds)
    result, lay_out = {**about, "rows": rows}, cutoffs.text if swept else text
    print(json.dumps(result, indent=1) if options.json else lay_out(result))
    return 0


def measure(config: LowPassConfig, seeds: int, seconds: float) -> list[dict[str, Any]]:
    """Walk on the estimate under every noise profile."""
    rows = []
    for name, profile in PROFILES.items():
        for motion in VELOCITIES:
            walks = [walk(motion, profile, seed, seconds, config) for seed in range(seeds)]
            rows.append(row(name, motion, walks, [each.estimates for each in walks]))
            if name == DELAYED:
                held = [each.replay(Newest(each.model)) for each in walks]
                rows.append(row(f"{name}, held", motion, walks, held))
            print(f"{name}, {motion}: done", file=sys.stderr, flush=True)
    return rows


def row(
    profile: str, motion: str, walks: list[Walk], estimates: list[np.ndarray]
) -> dict[str, Any]:
    """Root mean square over walks of what estimates of them are off, worst cases counted."""
    errors = [each.errors(seen) for each, seen in zip(walks, estimates, strict=True)]
    return {
        "profile": profile,
        "motion": motion,
        "walked": sum(not each.reason for each in walks),
        "runs": len(walks),
        "ended": sorted({each.reason for each in walks if each.reason}),
        "outliers": sum(each.outliers for each in walks),
        **mean_errors(errors)._asdict(),
    }


def text(result: dict[str, Any]) -> str:
    """Lay out what was measured."""
    heads = ("profile", "motion", "walked", *(title(name) for name in Errors._fields))
    rows = [
        (
            *(r["profile"], r["motion"], f"{r['walked']}/{r['runs']}"),
            *(f"{r[name]:.3g}" for name in Errors._fields),
        )
        for r in result["rows"]
    ]
    settings = ", ".join(f"{key} {value:g}" for key, value in result["filters"].items())
    return "\n\n".join(
        (
            heading("bench estimator", result),
            f"Spot walks {result['seconds']:g} s on the estimated state, {result['seeds']} seeds a "
            "row: straight into the box and pushing it (push), or turning away from it (turn). "
            "Root mean square of each channel's error vector, the first second left out. The first "
            "rows disturb the sensors alone, with the values of the hard plant; the last two are "
            "the whole plants. Held: the newest packets of the row above's walks as they are, not "
            f"moved on to the tick. Filters: {settings}.",
            markdown(heads, rows),
        )
    )
