"""Distillation: networks that say at once about what the planner would search for, and find."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from torch import nn  # pyright: ignore[reportMissingImports]

from sumo_dist.errors import UsageError
from sumo_dist.learn.layers import layers_of
from sumo_dist.learn.recordings import Examples
from sumo_dist.planner.learned import LearnedPolicy, LearnedValue
from sumo_dist.policies.network import Layer

LEAST_DEVIATION = 1e-2  # of an input that hardly varies, so that it is not blown up
TINY = 1e-9  # variance of an output that does not vary
LEAST_COST = 0.5  # added to both costs of a ratio: near a goal little is as good as nothing
LOG_COUNTS = (-6.0, 2.0)  # so that no example counts for all


@dataclass(frozen=True)
class DistilConfig:
    """Settings of the fit.

    Attributes:
        hidden: units of the network's hidden layers.
        epochs: passes over the examples, at most; the one of least held-out error is kept.
        batch: examples a step.
        learning_rate: of Adam.
        held_out: share of the runs on which the error is measured.
        sharpness: of the policy's choice among what was done; 0 lets all examples count alike.
        noise: standard deviation that is added to normalised inputs, so that states near those that
            were seen have about the same plans.
    """

    hidden: tuple[int, ...] = (128, 128)
    epochs: int = 30
    batch: int = 256
    learning_rate: float = 1e-3
    held_out: float = 0.1
    sharpness: float = 4.0
    noise: float = 0.3


@dataclass(frozen=True)
class Fit:
    """What came of it.

    Attributes:
        layers: of the network of the best epoch.
        epoch: which that was.
        error: mean squared error of its outputs on held-out runs.
        spread: that of a network that knows only their mean.
        explained: (outputs,) share of their variance there that the network explains, from 0 to 1.
    """

    layers: tuple[Layer, ...]
    epoch: int
    error: float
    spread: float
    explained: tuple[float, ...] = ()

    def __str__(self) -> str:
        """For people."""
        return (
            f"best epoch {self.epoch}: held-out error {self.error:.4f} of a variance "
            f"{self.spread:.4f}"
        )


def distil(
    examples: Examples,
    value: LearnedValue,
    config: DistilConfig,
    seed: int,
    origin: Mapping[str, Any],
) -> tuple[LearnedPolicy, Fit]:
    """Fit a policy to what was done; equal arguments give equal bits.

    What led to less cost than the value expects counts more, by a power of the ratio: advantage-
    weighted regression (arXiv:1910.00177), with ratios since tasks' costs differ in size. Without
    it the policy is the mean of what the planner did, which beside an object is mostly to dither.

    Args:
        examples: what it learns from.
        value: of their states, see `distil_value`.
        config: settings of the fit.
        seed: of weights, order and held-out runs.
        origin: how the policy was made, for its contract.

    Raises:
        UsageError: there is only one plan.
    """
    expected = value(examples.observations) + LEAST_COST
    better = np.log(expected / (examples.to_come + LEAST_COST))
    counts = np.exp(np.clip(config.sharpness * better, *LOG_COUNTS)).astype(np.float32)
    knots = examples.knots.reshape(len(examples.knots), -1)
    fit = _fit(examples, knots, counts, config, seed)
    contract = replace(examples.contract, origin=origin, trust=fit.explained)
    return LearnedPolicy(contract, fit.layers), fit


def distil_value(
    examples: Examples,
    config: DistilConfig,
    seed: int,
    origin: Mapping[str, Any],
) -> tuple[LearnedValue, Fit]:
    """Fit a value to the cost that was to come; arguments and errors as of `distil`."""
    alike = np.ones(len(examples.to_come), np.float32)
    fit = _fit(examples, examples.to_come[:, None], alike, config, seed)
    return LearnedValue(replace(examples.contract, times=(), origin=origin), fit.layers), fit


def _fit(
    examples: Examples,
    labels: np.ndarray,
    counts: np.ndarray,
    config: DistilConfig,
    seed: int,
) -> Fit:
    """Fit a network to labels (N, outputs) of the examples, which count so much each, (N,)."""
    if len(labels) < 2:
        raise UsageError("a single plan is nothing to learn from: give more runs, or longer ones")
    torch.set_num_threads(1)  # sums over threads would depend on their number
    torch.manual_seed(seed)
    held_out = _held_out(examples.runs, config.held_out, np.random.default_rng(seed))
    learnt, tested = (
        [torch.from_numpy(array[rows]) for array in (examples.observations, labels, counts)]
        for rows in (~held_out, held_out)
    )
    mean, deviation = learnt[0].mean(0), learnt[0].std(0).clamp(min=LEAST_DEVIATION)
    shift, scale = learnt[1].mean(0), learnt[1].std().clamp(min=LEAST_DEVIATION)
    network = _network(labels.shape[1], learnt[0].shape[1], config.hidden)
    adam = torch.optim.Adam(network.parameters(), config.learning_rate)
    spreads = _errors(tested[1].mean(0), tested[1], tested[2])
    best = Fit((), 0, np.inf, spreads.mean().item())
    for epoch in range(1, config.epochs + 1):
        for rows in torch.randperm(len(learnt[0])).split(config.batch):
            inputs = (learnt[0][rows] - mean) / deviation
            inputs = inputs + config.noise * torch.randn_like(inputs)
            adam.zero_grad()
            wanted = (learnt[1][rows] - shift) / scale
            _errors(network(inputs), wanted, learnt[2][rows]).mean().backward()
            adam.step()
        with torch.inference_mode():
            found = network((tested[0] - mean) / deviation) * scale + shift
            errors = _errors(found, tested[1], tested[2])
        error = errors.mean().item()
        if error < best.error:
            layers = layers_of(network, mean, deviation, scale, shift)
            explained = (1.0 - errors / spreads.clamp(min=TINY)).clamp(0.0, 1.0)
            best = Fit(layers, epoch, error, best.spread, tuple(explained.tolist()))
    return best


def _errors(found: torch.Tensor, wanted: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    """Mean squared errors (outputs,) over rows that count so much each."""
    return (counts[:, None] * (found - wanted) ** 2).sum(0) / counts.sum()


def _held_out(runs: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Which examples (N,) are of the runs that are held out: at least one, and not all."""
    count = int(runs.max()) + 1
    if count == 1:
        return np.arange(len(runs)) >= len(runs) - max(1, len(runs) // 10)  # a single run's end
    chosen = rng.permutation(count)[: min(count - 1, max(1, round(share * count)))]
    return np.isin(runs, chosen)


def _network(outputs: int, inputs: int, hidden: tuple[int, ...]) -> nn.Sequential:
    sizes, modules = (inputs, *hidden), list[nn.Module]()
    for before, after in pairwise(sizes):
        modules += [nn.Linear(before, after), nn.ELU()]
    return nn.Sequential(*modules, nn.Linear(sizes[-1], outputs))
