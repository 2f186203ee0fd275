"""The planner's settings, how the command line overrides them, and their hash."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import get_args

from sumo_dist.errors import UsageError, unknown
from sumo_dist.math.splines import Order
from sumo_dist.optim import OPTIMIZERS
from sumo_dist.rollout.interface import TICK

# far beyond any use: a slip of the pen must not fill the memory
_MOST = {"rollouts": 4096, "nodes": 100, "iterations": 100, "elites": 4096}


@dataclass(frozen=True)
class PlannerConfig:
    """One set of settings for every task.

    Attributes:
        optimizer: "cem", "mppi" or "ps".
        horizon: [s], a whole number of policy steps.
        rollouts: candidate plans per iteration, the unperturbed one included.
        nodes: knots per plan.
        spline: "zero", "linear" or "cubic".
        iterations: optimizer iterations per plan.
        variance_first, variance_last: noise variance of the first and last node, in normalised
            actions; linear between them (paper: 0.02 and 0.6).
        elites: of CEM.
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
    variance_first: float = 0.02
    variance_last: float = 0.6
    elites: int = 3
    temperature: float = 0.1
    timestep: float = 0.02
    fluid_density: float = 0.0

    def __post_init__(self) -> None:
        if self.optimizer not in OPTIMIZERS:
            raise unknown("optimizer", self.optimizer, OPTIMIZERS)
        if self.spline not in get_args(Order):
            raise unknown("spline", self.spline, get_args(Order))
        for name, most in _MOST.items():
            if not 1 <= getattr(self, name) <= most:
                raise UsageError(f"{name} must be from 1 to {most}, got {getattr(self, name)}")
        if not 0 < self.horizon <= 20 or abs(self.horizon / TICK - self.steps) > 1e-6:
            raise UsageError(
                f"horizon must be a multiple of {TICK} s up to 20 s, got {self.horizon}"
            )
        substeps = TICK / self.timestep if self.timestep > 0 else 0.0
        if not 1 <= substeps <= 100 or abs(substeps - round(substeps)) > 1e-6:
            raise UsageError(
                f"timestep must divide {TICK} s and be at least {TICK / 100} s, got {self.timestep}"
            )
        for name in ("variance_first", "variance_last", "temperature"):
            if not 0 < getattr(self, name) < 100:
                raise UsageError(
                    f"{name} must be positive and below 100, got {getattr(self, name)}"
                )
        if not 0 <= self.fluid_density < 100:
            raise UsageError(f"fluid_density must be in [0, 100), got {self.fluid_density}")

    @property
    def steps(self) -> int:
        """Policy steps T per rollout."""
        return round(self.horizon / TICK)

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
