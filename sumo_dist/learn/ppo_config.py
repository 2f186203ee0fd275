"""Settings of the learner. Needs no torch, so that options can be read without."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PPOConfig:
    """Settings of the learner; rsl_rl's own otherwise.

    Attributes:
        hidden: units of the networks' hidden layers.
        steps: actions of each episode between two updates.
        deviation: of the first actions from standing still, normalised.
        base_deviation: the same of the base's velocities: a robot that hardly walks learns nothing.
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
    learning_rate: float = 3e-4
    kl: float = 0.0
    entropy: float = 0.001
    horizon: float = 5.0
    decay: float = 0.95
    epochs: int = 5
    batches: int = 8
