"""`sumo-dist bench estimator`: how far the estimated state is from the true one, by channel."""

import json
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro

from sumo_dist.bench.report import heading, markdown, timing_provenance
from sumo_dist.episode.disturb import NOMINAL, PLANTS, PlantProfile
from sumo_dist.episode.plant import Plant
from sumo_dist.episode.start import draw_start, make_guard
from sumo_dist.errors import SumoError, UsageError, unknown
from sumo_dist.estimate import LowPassConfig, LowPassEstimator
from sumo_dist.math.rotations import conjugate, multiply, to_rotation_vector
from sumo_dist.model.index import StateIndex
from sumo_dist.policies import load_policy
from sumo_dist.robots.spot import SPOT
from sumo_dist.rollout.interface import TICK
from sumo_dist.tasks import load_task

TASK = "spot/move_box"
SETTLE_S = 1.0  # not counted: the filters start at rest
VELOCITIES = {"push": (0.5, 0.0, 0.0), "turn": (0.3, 0.0, 0.5)}  # vx, vy [m/s], wz [rad/s]
BOX_AHEAD = {"push": 1.1, "turn": 10.0}  # distance of the box from the robot [m]

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
        if self.seeds < 1:
            raise UsageError(f"seeds must be at least 1, got {self.seeds}")
        if not SETTLE_S < self.seconds <= 600:
            raise UsageError(f"seconds must be in ({SETTLE_S:g}, 600], got {self.seconds}")


class Errors(NamedTuple):
    """Root mean square of what each channel is off, over time, per vector."""

    base_mm: float
    base_mrad: float
    base_m_s: float
    base_rad_s: float
    joints_mrad: float
    joints_rad_s: float
    box_mm: float
    box_mrad: float
    box_m_s: float
    box_rad_s: float


def main(options: Options) -> int:
    """Walk on the estimate under every noise profile; print a table or one JSON object."""
    config = filters(options.set)
    rows = []
    for name, profile in PROFILES.items():
        for motion in VELOCITIES:
            runs = [
                walk(motion, profile, config, seed, options.seconds)
                for seed in range(options.seeds)
            ]
            rows.append(row(name, motion, runs))
            print(f"{name}, {motion}: done", file=sys.stderr, flush=True)
    about = {**timing_provenance(), "filters": vars(config), "seeds": options.seeds}
    result = {**about, "seconds": options.seconds, "rows": rows}
    print(json.dumps(result, indent=1) if options.json else text(result))
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


@dataclass(frozen=True)
class Run:
    """One walk.

    Attributes:
        errors: of the estimate, None if the walk ended too early for any.
        outliers: poses that the estimator left out.
        reason: "" if it walked to the end, else why not.
    """

    errors: Errors | None
    outliers: int
    reason: str


def walk(
    motion: str, profile: PlantProfile, config: LowPassConfig, seed: int, seconds: float
) -> Run:
    """Let the policy walk on the estimated state; it meets the box if the motion is a push."""
    task = load_task(TASK)
    start, index = _start(motion)
    plant = Plant(task.scene, start, "lowpass", profile, seed)
    guard, policy, nq = make_guard(task, plant), load_policy("spot"), plant.model.nq
    estimate = LowPassEstimator(plant.model, config)
    command, memory = np.array(SPOT.default_command), policy.initial_memory()
    command[:3] = VELOCITIES[motion]
    states, estimates, reason = [], [], ""
    try:
        while plant.tick * TICK < seconds:
            seen = estimate(plant.read())
            states.append(plant.state)
            estimates.append(seen)
            targets, memory = policy.step(seen[:nq], seen[nq:], command, memory)
            guard.send(targets)
            if plant.state[2] < SPOT.fall_height:
                raise SumoError("fell")
    except SumoError as error:
        reason = str(error)
    first = round(SETTLE_S / TICK)
    counted = np.array(states[first:]), np.array(estimates[first:])
    errors = errors_of(index, *counted) if len(counted[0]) else None
    return Run(errors, estimate.outliers, reason)


def errors_of(index: StateIndex, states: np.ndarray, estimates: np.ndarray) -> Errors:
    """Compare estimates (T, nq + nv) with the states they are of."""
    positions, velocities = index.joints(SPOT.joints)
    off = estimates - states
    joints = _rms(off[:, positions]) * 1e3, _rms(off[:, velocities])
    base, box = (list(_body(index, body, states, estimates, off)) for body in ("body", "box"))
    return Errors._make([*base, *joints, *box])


def _body(
    index: StateIndex, body: str, states: np.ndarray, estimates: np.ndarray, off: np.ndarray
) -> Iterator[float]:
    pose, velocity = index.pose(body), index.velocity(body)
    turned = multiply(conjugate(states[:, pose][:, 3:]), estimates[:, pose][:, 3:])
    yield _rms(off[:, pose][:, :3]) * 1e3
    yield _rms(to_rotation_vector(turned)) * 1e3
    yield from (_rms(part) for part in np.split(off[:, velocity], 2, axis=1))


def row(profile: str, motion: str, runs: list[Run]) -> dict[str, Any]:
    """Root mean square over runs, worst cases counted."""
    measured = [run.errors for run in runs if run.errors is not None]
    squares = np.square(np.array(measured)).mean(axis=0) if measured else np.full(10, np.nan)
    means = dict(zip(Errors._fields, np.sqrt(squares).round(4).tolist(), strict=True))
    ended = sorted({run.reason for run in runs if run.reason})
    return {
        "profile": profile,
        "motion": motion,
        "walked": sum(not run.reason for run in runs),
        "runs": len(runs),
        "ended": ended,
        "outliers": sum(run.outliers for run in runs),
        **means,
    }


def text(result: dict[str, Any]) -> str:
    """Lay out what was measured."""
    heads = ("profile", "motion", "walked", *(_title(name) for name in Errors._fields))
    rows = [
        (
            *(r["profile"], r["motion"], f"{r['walked']}/{r['runs']}"),
            *(f"{r[name]:.3g}" for name in Errors._fields),
        )
        for r in result["rows"]
    ]
    cutoffs = ", ".join(f"{key} {value:g}" for key, value in result["filters"].items())
    return "\n\n".join(
        (
            heading("bench estimator", result),
            f"Spot walks {result['seconds']:g} s on the estimated state, {result['seeds']} seeds a "
            "row: straight into the box and pushing it (push), or turning away from it (turn). "
            "Root mean square of each channel's error vector, the first second left out. The first "
            "rows disturb the sensors alone, with the values of the hard plant; the last two are "
            f"the whole plants. Filters: {cutoffs}.",
            markdown(heads, rows),
        )
    )


def _title(name: str) -> str:
    what, _, unit = name.partition("_")
    return f"{what} [{unit.replace('_', '/')}]"


def _start(motion: str) -> tuple[np.ndarray, StateIndex]:
    task = load_task(TASK)
    state = draw_start(task, 0)
    index = StateIndex(Plant(task.scene, state).model)
    state[index.pose("body")][:2], state[index.pose("body")][3:] = 0.0, (1.0, 0.0, 0.0, 0.0)
    state[index.pose("box")][:2] = BOX_AHEAD[motion], 0.0
    return state, index


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=-1))))
