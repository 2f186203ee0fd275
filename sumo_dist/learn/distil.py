"""Distillation: a network that says at once about what the planner would search for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from torch import nn  # pyright: ignore[reportMissingImports]

from sumo_dist.errors import UsageError
from sumo_dist.learn.layers import layers_of
from sumo_dist.learn.recordings import Examples
from sumo_dist.planner.learned import LearnedPolicy

LEAST_DEVIATION = 1e-2  # of an input that hardly varies, so that it is not blown up


@dataclass(frozen=True)
class DistilConfig:
    """Settings of the fit.

    Attributes:
        hidden: units of the network's hidden layers.
        epochs: passes over the examples, at most; the one of least held-out error is kept.
        batch: examples a step.
        learning_rate: of Adam.
        held_out: share of the runs on which the error is measured.
        noise: standard deviation that is added to normalised inputs, so that states near those that
            were seen have about the same plans.
    """

    hidden: tuple[int, ...] = (256, 256)
    epochs: int = 60
    batch: int = 256
    learning_rate: float = 1e-3
    held_out: float = 0.1
    noise: float = 0.05


@dataclass(frozen=True)
class Fit:
    """What came of it.

    Attributes:
        policy: of the best epoch.
        epoch: which that was.
        error: mean squared error of its knots on held-out runs, in normalised actions.
        spread: variance of those knots: the error of a network that knows only their mean.
    """

    policy: LearnedPolicy
    epoch: int
    error: float
    spread: float


def distil(
    examples: Examples,
    config: DistilConfig,
    seed: int,
    origin: Mapping[str, Any],
    on_epoch: Callable[[int, float], None] = lambda _epoch, _error: None,
) -> Fit:
    """Fit a network to plans; equal arguments give equal bits.

    Args:
        examples: what it learns from.
        config: settings of the fit.
        seed: of weights, order and held-out runs.
        origin: how the policy was made, for its contract.
        on_epoch: is told each epoch's number and held-out error.

    Raises:
        UsageError: there is only one plan.
    """
    if len(examples.knots) < 2:
        raise UsageError("a single plan is nothing to learn from: give more runs, or longer ones")
    torch.set_num_threads(1)  # sums over threads would depend on their number
    torch.manual_seed(seed)
    held_out = _held_out(examples.runs, config.held_out, np.random.default_rng(seed))
    flat = examples.knots.reshape(len(examples.knots), -1)
    learnt, tested = (
        (torch.from_numpy(examples.observations[rows]), torch.from_numpy(flat[rows]))
        for rows in (~held_out, held_out)
    )
    mean, deviation = learnt[0].mean(0), learnt[0].std(0).clamp(min=LEAST_DEVIATION)
    network = _network(flat.shape[1], learnt[0].shape[1], config.hidden, learnt[1].mean(0))
    adam = torch.optim.Adam(network.parameters(), config.learning_rate)
    best, best_epoch, layers = np.inf, 0, layers_of(network, mean, deviation)
    for epoch in range(1, config.epochs + 1):
        for rows in torch.randperm(len(learnt[0])).split(config.batch):
            inputs = (learnt[0][rows] - mean) / deviation
            inputs = inputs + config.noise * torch.randn_like(inputs)
            adam.zero_grad()
            nn.functional.mse_loss(network(inputs), learnt[1][rows]).backward()
            adam.step()
        with torch.inference_mode():
            found = network((tested[0] - mean) / deviation)
            error = nn.functional.mse_loss(found, tested[1]).item()
        on_epoch(epoch, error)
        if error < best:
            best, best_epoch, layers = error, epoch, layers_of(network, mean, deviation)
    policy = LearnedPolicy(replace(examples.contract, origin=origin), layers)
    return Fit(policy, best_epoch, best, float(tested[1].numpy().var(axis=0).mean()))


def _held_out(runs: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Which examples (N,) are of the runs that are held out: at least one, and not all."""
    count = int(runs.max()) + 1
    if count == 1:
        return np.arange(len(runs)) >= len(runs) - max(1, len(runs) // 10)  # a single run's end
    chosen = rng.permutation(count)[: min(count - 1, max(1, round(share * count)))]
    return np.isin(runs, chosen)


def _network(
    outputs: int, inputs: int, hidden: tuple[int, ...], mean: torch.Tensor
) -> nn.Sequential:
    """Build a network that begins by returning a mean (outputs,)."""
    sizes, modules = (inputs, *hidden), list[nn.Module]()
    for before, after in pairwise(sizes):
        modules += [nn.Linear(before, after), nn.ELU()]
    last = nn.Linear(sizes[-1], outputs)
    with torch.no_grad():
        last.weight.mul_(0.1)
        last.bias.copy_(mean)
    return nn.Sequential(*modules, last)
