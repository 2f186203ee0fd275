"""Proximal policy optimization of an environment: rsl_rl's algorithm, bit-exact when resumed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from rsl_rl.algorithms import PPO  # pyright: ignore[reportMissingImports]
from rsl_rl.models import MLPModel  # pyright: ignore[reportMissingImports]
from rsl_rl.modules import EmpiricalNormalization  # pyright: ignore[reportMissingImports]
from rsl_rl.modules.distribution import GaussianDistribution  # pyright: ignore[reportMissingImports]
from rsl_rl.storage import RolloutStorage  # pyright: ignore[reportMissingImports]
from tensordict import TensorDict  # pyright: ignore[reportMissingImports]
from torch import nn  # pyright: ignore[reportMissingImports]

from sumo_dist.learn.environment import Environment, Outcome
from sumo_dist.learn.layers import layers_of
from sumo_dist.learn.ppo_config import PPOConfig
from sumo_dist.policies.network import Layer

GROUPS = {"actor": ["state"], "critic": ["state"]}


@dataclass(frozen=True)
class Account:
    """What happened between two updates.

    Attributes:
        reward: mean of an action.
        cost: mean cost of the states that were come to.
        ended, solved, fell: episodes.
        deviation: mean of the policy's actions, as a share of what it was at first.
    """

    reward: float
    cost: float
    ended: int
    solved: int
    fell: int
    deviation: float


class Learner:
    """A policy that learns from an environment, one update at a time."""

    def __init__(self, environment: Environment, config: PPOConfig, seed: int) -> None:
        """Begin with a policy that stands, give or take the configured deviations."""
        torch.manual_seed(seed)
        self._environment, self._config = environment, config
        space = environment.actions
        self._stand = torch.from_numpy(config.standing(space).astype(np.float32))
        self._scale = torch.from_numpy(config.deviations(space).astype(np.float32))
        observations = self._observations(environment.observe())
        count, actions = len(observations), len(self._stand)
        gaussian = {"class_name": "GaussianDistribution", "init_std": 1.0}  # before the scale
        shape = {"hidden_dims": config.hidden, "activation": "elu", "obs_normalization": True}
        self._actor = MLPModel(
            observations, GROUPS, "actor", actions, **shape, distribution_cfg=gaussian
        )
        critic = MLPModel(observations, GROUPS, "critic", 1, **shape)
        storage = RolloutStorage("rl", count, config.steps, observations, [actions])
        self._ppo = PPO(
            *(self._actor, critic, storage),
            num_learning_epochs=config.epochs,
            num_mini_batches=config.batches,
            gamma=float(np.exp(-1.0 / (config.horizon * environment.config.rate))),
            lam=config.decay,
            entropy_coef=config.entropy,
            learning_rate=config.learning_rate,
            schedule="adaptive" if config.kl else "fixed",
            desired_kl=config.kl,
            use_clipped_value_loss=False,
        )

    def begin_with(self, state: Mapping[str, Any], deviations: np.ndarray) -> None:
        """Begin with the networks of another learner, around what is configured of this one.

        So its first actions differ from the other's by how both stand, and have this one's noise.

        Args:
            state: what its `state` returned.
            deviations: (n,) of its first actions, see `PPOConfig.deviations`.
        """
        self._ppo.load(dict(state["ppo"]), {"actor": True, "critic": True}, strict=True)
        share = torch.from_numpy(deviations.astype(np.float32)) / self._scale
        last, distribution = self._actor.mlp[-1], self._actor.distribution
        assert isinstance(last, nn.Linear) and isinstance(distribution, GaussianDistribution)
        with torch.no_grad():
            last.weight.mul_(share[:, None])
            last.bias.mul_(share)
            distribution.std_param.fill_(1.0)

    def update(self) -> Account:
        """Gather experience with the policy as it is, then make it better."""
        self._ppo.train_mode()
        outcomes = []
        observations = self._observations(self._environment.observe())
        with torch.inference_mode():
            for _ in range(self._config.steps):
                actions = self._ppo.act(observations)
                normalised = self._stand + self._scale * actions
                outcome = self._environment.step(normalised.numpy().astype(float))
                observations = self._observations(outcome.observations)
                self._ppo.process_env_step(observations, *_feedback(outcome))
                outcomes.append(outcome)
            self._ppo.compute_returns(observations)
        self._ppo.update()
        return self._account(outcomes)

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The policy without noise: observations to normalised actions."""
        normaliser = self._actor.obs_normalizer
        assert isinstance(normaliser, EmpiricalNormalization), "asked for in `shape`"
        deviation = normaliser.std + normaliser.eps
        return layers_of(self._actor.mlp, normaliser.mean, deviation, self._scale, self._stand)

    def state(self) -> dict[str, Any]:
        """Return all that `restore` needs, as `torch.save` writes it."""
        return {
            "ppo": self._ppo.save(),
            "random": torch.get_rng_state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` returned in a learner that was made alike."""
        self._ppo.load(dict(state["ppo"]), None, strict=True)
        torch.set_rng_state(state["random"])

    def _observations(self, rows: np.ndarray) -> TensorDict:
        return TensorDict({"state": torch.from_numpy(rows)}, batch_size=[len(rows)])

    def _account(self, outcomes: list[Outcome]) -> Account:
        counts = {
            name: int(sum(getattr(outcome, name).sum() for outcome in outcomes))
            for name in ("ended", "solved", "fell")
        }
        return Account(
            reward=float(np.mean([outcome.rewards for outcome in outcomes])),
            cost=float(np.nanmean([outcome.cost for outcome in outcomes])),
            **counts,
            deviation=self._actor.output_std.mean().item(),
        )


def _feedback(outcome: Outcome) -> tuple[torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
    """Rewards, ends, and which of them are cut short, as rsl_rl takes them."""
    return (
        torch.from_numpy(outcome.rewards.astype(np.float32)),
        torch.from_numpy(outcome.ended),
        {"time_outs": torch.from_numpy(outcome.timed_out)},
    )
