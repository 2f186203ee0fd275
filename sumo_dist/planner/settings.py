"""What each setting of the planner is and may be: one table for checks, errors and the list."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple, get_args

from sumo_dist.errors import UsageError, unknown
from sumo_dist.math.splines import Order
from sumo_dist.optim import OPTIMIZERS, Placement
from sumo_dist.timing import TICK, TICK_RATE

Execute = Literal["mean", "best"]
Model = Literal["lean", "full"]
Guidance = Literal["none", "object", "learned"]


class Setting(NamedTuple):
    """A setting.

    Attributes:
        about: what it is, in a few words.
        valid: what it may be, in words.
        accepts: whether it may be some value of its type.
        choices: of a text, the names that it may be.
    """

    about: str
    valid: str
    accepts: Callable[[Any], bool]
    choices: tuple[str, ...] = ()

    def check(self, name: str, value: Any) -> None:
        """Raise a UsageError if the setting of this name may not be that value."""
        if self.accepts(value):
            return
        if self.choices:
            raise unknown(name, value, self.choices)
        raise UsageError(f"{name} must be {self.valid}, got {value}")


def _one_of(about: str, choices: tuple[str, ...]) -> Setting:
    return Setting(about, " ".join(choices), lambda name: name in choices, choices)


def _between(about: str, low: float, high: float) -> Setting:
    return Setting(about, f"from {low:g} to {high:g}", lambda number: low <= number <= high)


def _positive(about: str) -> Setting:
    return Setting(about, "positive and below 100", lambda number: 0 < number < 100)


def _is_horizon(seconds: float) -> bool:
    return 0 < seconds <= 20 and abs(seconds / TICK - round(seconds / TICK)) <= 1e-6


def _is_timestep(seconds: float) -> bool:
    substeps = TICK / seconds if seconds > 0 else 0.0
    return 1 <= substeps <= 100 and abs(substeps - round(substeps)) <= 1e-6


# Upper limits of counts are far beyond any use: a slip of the pen must not fill the memory.
SETTINGS = {
    "optimizer": _one_of("how candidates make the next plan", OPTIMIZERS),
    "horizon": Setting(
        "how far a plan looks ahead [s]", f"a multiple of {TICK} s up to 20 s", _is_horizon
    ),
    "rate": _between("plans per second of robot time [Hz]", 1, TICK_RATE),
    "rollouts": _between("candidates per plan", 1, 4096),
    "nodes": _between("spline knots per plan", 1, 100),
    "spline": _one_of("how actions run from knot to knot", get_args(Order)),
    "iterations": _between("optimizer iterations that share the rollouts", 1, 100),
    "decay": _between("each iteration has this factor fewer rollouts", 1, 10),
    "variance_first": _positive("noise variance at the first knot, normalised actions"),
    "variance_last": _positive("noise variance at the last knot"),
    "base_noise": _positive("noise of the base's velocities, over that of the rest"),
    "noise_exponent": _between("how smooth noise is over the knots; 0 is white", 0, 4),
    "placement": _one_of("which candidates have how much of the noise", get_args(Placement)),
    "execute": _one_of("which plan is followed", get_args(Execute)),
    "elites": _between("candidates that CEM and iCEM average", 1, 4096),
    "temperature": _positive("of MPPI, in units of the costs' spread"),
    "timestep": Setting(
        "physics step of the planning model [s]",
        f"a whole fraction of {TICK} s, at least {TICK / 100} s",
        _is_timestep,
    ),
    "fluid_density": Setting(
        "air in the planning model [kg/m^3]; 0 leaves drag out",
        "in [0, 100)",
        lambda density: 0 <= density < 100,
    ),
    "model": _one_of(
        "what rollouts are made with; full is all that the plant has", get_args(Model)
    ),
    "guidance": _one_of(
        "what proposes candidates. object: a walk that pushes the object; learned: a policy",
        get_args(Guidance),
    ),
    "policy": Setting(
        "the learned policy's file, from `sumo-dist train` or `sumo-dist distil`",
        "with guidance=learned a file on the optimizer's host",
        lambda path: "\0" not in path,
    ),
    "guided": _between("share of the candidates that are proposals; 0 is one of them", 0, 1),
}
