"""Settings of the learner. Needs no torch, so that options can be read without."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.costs.table import assignment
from sumo_dist.errors import UsageError, unknown
from sumo_dist.robots.robot import ActionSpace


@dataclass(frozen=True)
class PPOConfig:
    """Settings of the learner; rsl_rl's own otherwise.

    Attributes:
        hidden: units of the networks' hidden layers.
        steps: actions of each episode between two updates.
        deviation: of the first actions from standing still, normalised.
        base_deviation: the same of the base's velocities: a robot that hardly walks learns nothing.
        noise: the same of actions whose names begin alike, over what they would have, such as
            "arm=0.1".
        stand: of the first actions, in place of the task's of a robot that stands, such as
            "arm_sh1=-0.3", in the action's unit.
        learning_rate: of Adam, for both networks; where it is to follow, at first.
        kl: mean KL divergence of the actions that an update should come to, which the learning rate
            follows; 0: it stays.
        entropy: weight of the policy's entropy.
        horizon: after which a reward counts 1/e [s].
        decay: lambda of the generalised advantage estimate.
        epochs, batches: passes over what was gathered in an update, each in so many parts.
    """

    hidden: tuple[int, ...] = (128, 128)
    steps: int = 16
    deviation: float = 0.3
    base_deviation: float = 0.7
    noise: tuple[str, ...] = ()
    stand: tuple[str, ...] = ()
    learning_rate: float = 3e-4
    kl: float = 0.0
    entropy: float = 0.001
    horizon: float = 5.0
    decay: float = 0.95
    epochs: int = 5
    batches: int = 8

    def standing(self, actions: ActionSpace) -> np.ndarray:
        """Return the first actions without their noise, (n,), normalised.

        Raises:
            UsageError: it names no action of the task, or a value beyond its limits.
        """
        for text in self.stand:
            name, (value, *more) = assignment("stand", text)
            actions = actions.within(name, default=value)
            i = actions.names.index(name)
            if more or not actions.lower[i] <= value <= actions.upper[i]:
                limits = f"{actions.lower[i]:.3g} to {actions.upper[i]:.3g}"
                raise UsageError(f"stand {text!r} needs one number from {limits}")
        return actions.unit(actions.default)

    def deviations(self, actions: ActionSpace) -> np.ndarray:
        """Return those of the first actions from standing still, (n,), normalised.

        Raises:
            UsageError: a noise is no positive number, or its name begins none of an action.
        """
        names = np.array(actions.names)[actions.searched]
        deviations = np.where(actions.base, self.base_deviation, self.deviation)
        for text in self.noise:
            name, (share, *more) = assignment("noise", text)
            chosen = np.char.startswith(names, name)
            if not chosen.any():
                raise unknown("noise", name, names.tolist())
            if more or not 0.0 < share < np.inf:
                raise UsageError(f"noise {text!r} needs one positive number")
            deviations = np.where(chosen, share * deviations, deviations)
        return deviations
