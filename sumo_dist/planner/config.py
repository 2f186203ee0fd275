"""The planner's settings, how the command line overrides them, and their hash."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal, get_args

import numpy as np

from sumo_dist.errors import UsageError, unknown
from sumo_dist.math.splines import Order
from sumo_dist.model.scene import PLANT
from sumo_dist.optim import OPTIMIZERS
from sumo_dist.timing import TICK

Execute = Literal["mean", "best"]

# far beyond any use: a slip of the pen must not fill the memory
_MOST = {"rollouts": 4096, "nodes": 100, "iterations": 100, "elites": 4096}


@dataclass(frozen=True)
class PlannerConfig:
    """One set of settings for every task.

    Attributes:
        optimizer: one of optim.OPTIMIZERS.
        horizon: [s], a whole number of policy steps.
        rollouts: candidates per plan, all iterations and their unperturbed means included.
        nodes: knots per plan.
        spline: "zero", "linear" or "cubic".
        iterations: optimizer iterations per plan, among which the rollouts are divided.
        decay: each iteration has this factor fewer rollouts than the one before it.
        variance_first, variance_last: noise variance of the first and last node, in normalised
            actions; linear between them (paper: 0.02 and 0.6).
        base_noise: standard deviation of the base's velocities, over that of all other actions.
        noise_exponent: power of the noise falls as 1 / frequency^exponent over the nodes; 0 is
            white: independent nodes.
        execute: "mean" of the last iteration or the "best" candidate of all of them.
        elites: of CEM and iCEM.
        temperature: of MPPI, in units of the costs' spread.
        timestep: physics step of the planning model [s].
        fluid_density: of the planning model [kg/m^3]; 0 leaves air drag out.
    """

    optimizer: str = "cem"
    horizon: float = 1.5
    rollouts: int = 32
    nodes: int = 4
    spline: Order = "linear"
    iterations: int = 1
    decay: float = 1.0
    variance_first: float = 0.02
    variance_last: float = 0.6
    base_noise: float = 2.0
    noise_exponent: float = 0.0
    execute: Execute = "mean"
    elites: int = 3
    temperature: float = 0.1
    timestep: float = 0.02
    fluid_density: float = 0.0

    def __post_init__(self) -> None:
        self._check_choices()
        self._check_counts()
        self._check_times()
        for name in ("variance_first", "variance_last", "base_noise", "temperature"):
            if not 0 < getattr(self, name) < 100:
                raise UsageError(
                    f"{name} must be positive and below 100, got {getattr(self, name)}"
                )
        if not 0 <= self.fluid_density < 100:
            raise UsageError(f"fluid_density must be in [0, 100), got {self.fluid_density}")
        if not 0 <= self.noise_exponent <= 4:
            raise UsageError(f"noise_exponent must be from 0 to 4, got {self.noise_exponent}")
        if not 1 <= self.decay <= 10:
            raise UsageError(f"decay must be from 1 to 10, got {self.decay}")

    def _check_choices(self) -> None:
        choices = {
            "optimizer": OPTIMIZERS,
            "spline": get_args(Order),
            "execute": get_args(Execute),
        }
        for name, valid in choices.items():
            if getattr(self, name) not in valid:
                raise unknown(name, getattr(self, name), valid)

    def _check_counts(self) -> None:
        for name, most in _MOST.items():
            if not 1 <= getattr(self, name) <= most:
                raise UsageError(f"{name} must be from 1 to {most}, got {getattr(self, name)}")
        if self.rollouts < self.iterations:
            raise UsageError(
                f"{self.iterations} iterations need at least as many rollouts, got {self.rollouts}"
            )

    def _check_times(self) -> None:
        if not 0 < self.horizon <= 20 or abs(self.horizon / TICK - self.steps) > 1e-6:
            raise UsageError(
                f"horizon must be a multiple of {TICK} s up to 20 s, got {self.horizon}"
            )
        substeps = TICK / self.timestep if self.timestep > 0 else 0.0
        if not 1 <= substeps <= 100 or abs(substeps - round(substeps)) > 1e-6:
            raise UsageError(
                f"timestep must divide {TICK} s and be at least {TICK / 100} s, got {self.timestep}"
            )

    @property
    def steps(self) -> int:
        """Policy steps T per rollout."""
        return round(self.horizon / TICK)

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

    def with_settings(self, settings: Iterable[str]) -> "PlannerConfig":
        """Apply "key=value" texts; an unknown key or an unreadable value names what is valid."""
        types = {f.name: type(getattr(self, f.name)) for f in fields(self)}
        changes = {}
        for setting in settings:
            key, equals, text = setting.partition("=")
            if not equals:
                raise UsageError(f"setting {setting!r} is not of the form key=value")
            if key not in types:
                raise unknown("setting", key, types)
            try:
                changes[key] = types[key](text)
            except ValueError:
                raise UsageError(
                    f"setting {key} needs a value of type {types[key].__name__}, got {text!r}"
                ) from None
        return replace(self, **changes)

    @classmethod
    def from_settings(cls, settings: Mapping[str, int | float | str]) -> "PlannerConfig":
        """Build from all settings by name, as they come over the wire."""
        types = {f.name: type(f.default) for f in fields(cls)}
        if {name: type(value) for name, value in settings.items()} != types:
            valid = ", ".join(f"{name}: {kind.__name__}" for name, kind in types.items())
            raise UsageError(f"planner settings of another version; valid: {valid}")
        return cls(**settings)  # pyright: ignore[reportArgumentType]  # types are those above

    def hash(self, task_hash: str) -> str:
        """Short SHA-256 over the settings and the task they plan for."""
        text = json.dumps({"task": task_hash, **asdict(self)}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


# The paper calls its noise scale, 0.02 to 0.6, a variance, and plans with the plant's model. What
# its search depends on is written out, so that better defaults do not change it.
PRESETS: dict[str, dict[str, Any]] = {
    "default": {},
    "paper": {
        "optimizer": "cem",
        "horizon": 1.5,
        "rollouts": 32,
        "nodes": 4,
        "spline": "linear",
        "iterations": 1,
        "decay": 1.0,
        "variance_first": 0.02,
        "variance_last": 0.6,
        "base_noise": 1.0,
        "noise_exponent": 0.0,
        "execute": "mean",
        "elites": 3,
        "timestep": PLANT.timestep,
        "fluid_density": PLANT.fluid_density,
    },
}

# What adapts within a plan needs more than one iteration; the rest is iCEM's own.
_SUITED: dict[str, dict[str, Any]] = {
    "cma": {"iterations": 2},
    "icem": {"iterations": 2, "decay": 1.25, "noise_exponent": 1.0, "execute": "best"},
}
