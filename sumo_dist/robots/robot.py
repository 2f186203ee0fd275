"""What a robot is to the planner: a model, a stance, a policy and a space of actions."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from sumo_dist.errors import UsageError, unknown
from sumo_dist.robots.safety import Safety


@dataclass(frozen=True)
class Robot:
    """A legged robot driven by a pretrained low-level policy.

    Joint tuples follow the model's qpos order; positions are in rad, heights in m.
    """

    name: str
    mjcf: str  # path below assets/
    base: str  # body that carries the free joint
    joints: tuple[str, ...]  # the actuated joints, in qpos and actuator order
    stand: tuple[float, ...]  # joint positions of the stance every task starts from [rad]
    stand_height: float  # base height of that stance before it is settled [m]
    sit: tuple[float, ...]  # joint positions of the safe stop [rad]
    fall_height: float  # below this base height the robot counts as fallen [m]
    policy: str  # name in policies/manifest.toml
    default_command: tuple[float, ...]  # policy command that makes it stand still
    safety: Safety = field(default_factory=Safety)  # limits of its commands and its state


@dataclass(frozen=True)
class ActionSpace:
    """The planner's action a and the map c = g(a) to the policy's command.

    Attributes:
        names: what each of the nu dimensions is.
        lower, upper: (nu,) physical limits; a dimension with lower == upper is fixed.
        default: (nu,) the action of a robot that stands and waits.
        to_command: (..., nu) physical action -> (..., nc) policy command, elementwise.
        velocities: indices of the dimensions that are velocities of the base, which the planner
            searches with a noise of their own; three of them are x, y and yaw, in this order.
        noise: (nu,) standard deviation of each dimension's search noise, over that of the planner's
            settings; one number is that of all.
    """

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    default: np.ndarray
    to_command: Callable[[np.ndarray], np.ndarray]
    velocities: tuple[int, ...] = ()
    noise: np.ndarray = field(default_factory=lambda: np.array(1.0))
    searched: np.ndarray = field(init=False)  # (ns,) indices of the dimensions with width

    def __post_init__(self) -> None:
        shapes = {np.shape(v) for v in (self.lower, self.upper, self.default)}
        if shapes != {(len(self.names),)}:
            raise UsageError(f"action space: limits of shapes {shapes} for {len(self.names)} names")
        if np.any(self.lower > self.upper):
            raise UsageError("action space: a lower limit exceeds its upper limit")
        if any(not 0 <= i < len(self.names) for i in self.velocities):
            raise UsageError(
                f"action space: velocities {self.velocities} of {len(self.names)} dimensions"
            )
        noise, each = np.asarray(self.noise, float), (len(self.names),)
        if noise.shape not in ((), each) or not np.all((noise > 0.0) & np.isfinite(noise)):
            raise UsageError(
                "action space: noise must be a positive number, or one for each of "
                f"{len(self.names)} dimensions, got {self.noise}"
            )
        object.__setattr__(self, "noise", np.broadcast_to(noise, each))
        object.__setattr__(self, "searched", np.flatnonzero(self.upper > self.lower))

    def within(
        self,
        name: str,
        *,
        lower: float | None = None,
        upper: float | None = None,
        default: float | None = None,
    ) -> "ActionSpace":
        """Return the space with other limits or another default of one dimension.

        Raises:
            UsageError: there is no such dimension, or its limits cross.
        """
        if name not in self.names:
            raise unknown("dimension of an action", name, self.names)
        changed = {}
        for what, value in {"lower": lower, "upper": upper, "default": default}.items():
            changed[what] = getattr(self, what).copy()
            if value is not None:
                changed[what][self.names.index(name)] = value
        return replace(self, **changed)

    @property
    def base(self) -> np.ndarray:
        """Which of the searched dimensions are velocities of the base, (ns,) bool."""
        return np.isin(self.searched, self.velocities)

    @property
    def size(self) -> int:
        """Number ns of dimensions that are searched."""
        return len(self.searched)

    def physical(self, unit: np.ndarray) -> np.ndarray:
        """Map searched dimensions in [-1, 1], (..., ns), to full physical actions, (..., nu)."""
        lower, upper = self.lower[self.searched], self.upper[self.searched]
        actions = np.broadcast_to(self.lower, (*unit.shape[:-1], len(self.names))).copy()
        actions[..., self.searched] = lower + (unit + 1.0) * 0.5 * (upper - lower)
        return actions

    def unit(self, action: np.ndarray) -> np.ndarray:
        """Map full physical actions, (..., nu), to searched dimensions in [-1, 1], (..., ns)."""
        lower, upper = self.lower[self.searched], self.upper[self.searched]
        return (action[..., self.searched] - lower) / (upper - lower) * 2.0 - 1.0

    def commands(self, unit: np.ndarray) -> np.ndarray:
        """c = g(a): unit actions (..., ns) to policy commands (..., nc)."""
        return self.to_command(self.physical(unit))


def written_into(command: np.ndarray, places: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return the map from actions (..., nu) to copies of a command (nc,) that have them in places.

    Args:
        command: (nc,) what it is but for the action.
        places: (nu,) where in the command each dimension of the action stands.
    """

    def to_command(action: np.ndarray) -> np.ndarray:
        commands = np.broadcast_to(command, (*action.shape[:-1], len(command))).copy()
        commands[..., places] = action
        return commands

    return to_command
