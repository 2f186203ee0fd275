"""The planner's settings, how the command line overrides them, and their hash."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from numbers import Real
from operator import index
from pathlib import Path
from typing import Any

import numpy as np

from sumo_dist.errors import UsageError, unknown
from sumo_dist.math.splines import Order, given
from sumo_dist.model.scene import PLANT
from sumo_dist.optim import Placement
from sumo_dist.planner.settings import SETTINGS, Execute, Guidance, Model
from sumo_dist.timing import PLAN_RATE, TICK


@dataclass(frozen=True)
class PlannerConfig:
    """Settings of the planner; `planner.settings` has what each may be.

    Attributes:
        optimizer: one of optim.OPTIMIZERS.
        horizon: [s], a whole number of policy steps.
        rate: plans per second of robot time [Hz]; each is anchored on a policy step.
        rollouts: candidates per plan, all iterations and their unperturbed means included.
        nodes: knots per plan.
        spline: "zero", "linear", "cubic" or "smooth", a cubic that begins with a knot of a
            tick ago: targets of limbs go on where the plan before is, in value and slope.
        iterations: optimizer iterations per plan, among which the rollouts are divided.
        decay: each iteration has this factor fewer rollouts than the one before it.
        variance_first, variance_last: noise variance of the first and last node, in normalised
            actions; linear between them (paper: 0.02 and 0.6).
        base_noise: standard deviation of the base's velocities, over that of all other actions.
        noise_exponent: power of the noise falls as 1 / frequency^exponent over the nodes; 0 is
            white: independent nodes.
        placement: "alike", all candidates have that noise, or "near", every second one has a third
            of it.
        execute: "mean" of the last iteration or the "best" candidate of all of them.
        elites: of CEM and iCEM.
        temperature: of MPPI, in units of the costs' spread.
        timestep: physics step of the planning model [s].
        fluid_density: of the planning model [kg/m^3]; 0 leaves air drag out.
        model: the planning model is "lean", see `model.departures`, or "full".
        guidance: "object" plans for the object first, and proposes the walk that brings it to its
            goal; "learned" proposes what a learned policy would do, see `planner.guidance`; "none"
            draws all candidates.
        policy: the learned policy's file on the optimizer's host, which is made absolute; ""
            without such guidance.
        guided: share of the first iteration's candidates that are proposals, all with noise but one
            of those for the object. 0 is one; 1 leaves out the last plan, and one is exact.
    """

    optimizer: str = "ps"
    horizon: float = 1.5
    rate: int = PLAN_RATE
    rollouts: int = 16
    nodes: int = 5
    spline: Order = "smooth"
    iterations: int = 1
    decay: float = 1.0
    variance_first: float = 0.02
    variance_last: float = 0.6
    base_noise: float = 2.0
    noise_exponent: float = 0.0
    placement: Placement = "alike"
    execute: Execute = "mean"
    elites: int = 3
    temperature: float = 0.1
    timestep: float = 0.02
    fluid_density: float = 0.0
    model: Model = "lean"
    guidance: Guidance = "none"
    policy: str = ""
    guided: float = 0.0

    def __post_init__(self) -> None:
        for name, setting in SETTINGS.items():
            setting.check(name, getattr(self, name))
        if self.rollouts < self.iterations:
            raise UsageError(
                f"{self.iterations} iterations need at least as many rollouts, got {self.rollouts}"
            )
        if self.nodes <= given(self.spline):
            raise UsageError(
                f"a {self.spline} spline needs at least {given(self.spline) + 1} nodes, "
                f"got {self.nodes}"
            )
        if bool(self.policy) != (self.guidance == "learned"):
            raise UsageError(
                "guidance=learned needs policy=FILE, and nothing else has one; got "
                f"guidance={self.guidance} with policy={self.policy or '(none)'}"
            )
        if self.policy:
            object.__setattr__(self, "policy", str(Path(self.policy).absolute()))

    @property
    def steps(self) -> int:
        """Policy steps T per rollout."""
        return round(self.horizon / TICK)

    @property
    def period(self) -> float:
        """Robot time between plans, on average [s]."""
        return 1 / self.rate

    @property
    def populations(self) -> tuple[int, ...]:
        """Candidates of each iteration, at least one; together they are the rollouts."""
        shares = self.decay ** -np.arange(self.iterations)
        free = self.rollouts - self.iterations
        ends = np.round(np.cumsum(shares) / shares.sum() * free).astype(int)
        return tuple((1 + np.diff(ends, prepend=0)).tolist())

    @classmethod
    def preset(cls, name: str, optimizer: str | None = None) -> "PlannerConfig":
        """Return settings by name: "default", or "paper" for the paper's letter.

        Args:
            name: of the preset.
            optimizer: takes the place of the preset's, with the settings that make it itself.
        """
        if name not in PRESETS:
            raise unknown("preset", name, PRESETS)
        preset = cls(**PRESETS[name])
        if optimizer is None:
            return preset
        return replace(preset, optimizer=optimizer, **_SUITED.get(optimizer, {}))

    @classmethod
    def resolve(
        cls,
        of_task: Mapping[str, Any],
        preset: str = "default",
        optimizer: str | None = None,
        settings: Iterable[str] = (),
    ) -> "PlannerConfig":
        """Settings of a run: a preset's, over them the task's, over them those that were asked for.

        Args:
            of_task: settings that the task states, see `Task.planner`.
            preset: name of the settings to start from.
            optimizer: takes the place of the preset's and the task's, with its own settings.
            settings: "key=value" texts.
        """
        own = _SUITED.get(optimizer, {}) if optimizer else {}
        stated = {k: v for k, v in of_task.items() if k != "optimizer" and k not in own}
        start = cls.preset(preset, optimizer or of_task.get("optimizer"))
        return start.changed(stated).with_settings(settings)

    def changed(self, settings: Mapping[str, Any]) -> "PlannerConfig":
        """Apply settings by name; an unknown name or a value of another type says what is valid."""
        return replace(self, **{key: self._typed(key, value) for key, value in settings.items()})

    def with_settings(self, settings: Iterable[str]) -> "PlannerConfig":
        """Apply "key=value" texts; an unknown key or an unreadable value names what is valid."""
        changes = {}
        for setting in settings:
            key, equals, text = setting.partition("=")
            if not equals:
                raise UsageError(f"setting {setting!r} is not of the form key=value")
            kind = self._kind(key)
            try:
                changes[key] = kind(text)
            except ValueError:
                raise _wrong_type(key, kind, text) from None
        return replace(self, **changes)

    def steered(self, settings: Iterable[str]) -> "PlannerConfig":
        """Apply "key=value" texts as `with_settings`, but for what cannot change in an episode.

        Its recording has one number of nodes, and a plan's number says on which tick it begins.
        """
        changed = self.with_settings(settings)
        for name in FIXED:
            if getattr(changed, name) != getattr(self, name):
                raise UsageError(f"{name} cannot change while an episode runs")
        return changed

    @staticmethod
    def _kind(key: str) -> type:
        """Type of a setting."""
        kinds = {f.name: type(f.default) for f in fields(PlannerConfig)}
        if key not in kinds:
            raise unknown("setting", key, kinds)
        return kinds[key]

    def _typed(self, key: str, value: object) -> Any:
        """Return a value as its setting has it: 2 is a horizon too, 2.0 and True are no counts."""
        kind = self._kind(key)
        try:
            if kind is int and not isinstance(value, bool):
                return index(value)  # pyright: ignore[reportArgumentType]  # raises TypeError
        except TypeError:
            pass
        if kind is float and isinstance(value, Real) and not isinstance(value, bool):
            return float(value)
        if kind is str and isinstance(value, str):
            return value
        raise _wrong_type(key, kind, value)

    @classmethod
    def from_settings(cls, settings: Mapping[str, int | float | str]) -> "PlannerConfig":
        """Build from all settings by name, as they come over the wire or are in a recording."""
        settings = {**_BEFORE, **settings}
        types = {f.name: type(f.default) for f in fields(cls)}
        if {name: type(value) for name, value in settings.items()} != types:
            valid = ", ".join(f"{name}: {kind.__name__}" for name, kind in types.items())
            raise UsageError(f"planner settings of another version; valid: {valid}")
        return cls(**settings)  # pyright: ignore[reportArgumentType]  # types are those above

    def hash(self, task_hash: str) -> str:
        """Short SHA-256 over the settings and the task they plan for."""
        text = json.dumps({"task": task_hash, **asdict(self)}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def _wrong_type(key: str, kind: type, value: object) -> UsageError:
    return UsageError(f"setting {key} needs a value of type {kind.__name__}, got {value!r}")


FIXED = ("nodes", "rate")  # of an episode, see `PlannerConfig.steered`

# What a setting was before there was one: runs of then still replay.
_BEFORE = {
    "model": "full",
    "guidance": "none",
    "placement": "alike",
    "rate": 20,
    "policy": "",
    "guided": 0.0,
}

# The paper calls its noise scale, 0.02 to 0.6, a variance, and plans with the plant's model. What
# its search depends on is written out, so that better defaults do not change it.
PRESETS: dict[str, dict[str, Any]] = {
    "default": {},
    "paper": {
        "optimizer": "cem",
        "horizon": 1.5,
        "rate": 20,
        "rollouts": 32,
        "nodes": 4,
        "spline": "linear",
        "iterations": 1,
        "decay": 1.0,
        "variance_first": 0.02,
        "variance_last": 0.6,
        "base_noise": 1.0,
        "noise_exponent": 0.0,
        "placement": "alike",
        "execute": "mean",
        "elites": 3,
        "timestep": PLANT.timestep,
        "fluid_density": PLANT.fluid_density,
        "model": "full",
        "guidance": "none",
        "policy": "",
        "guided": 0.0,
    },
}

# What adapts within a plan needs more than one iteration; the rest is iCEM's own.
_SUITED: dict[str, dict[str, Any]] = {
    "cma": {"iterations": 2},
    "icem": {"iterations": 2, "decay": 1.25, "noise_exponent": 1.0, "execute": "best"},
}
