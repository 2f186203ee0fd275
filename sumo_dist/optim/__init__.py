"""Sampling optimizers by name."""

from sumo_dist.errors import unknown
from sumo_dist.optim.cem import CrossEntropy
from sumo_dist.optim.cma import CovarianceAdaptation
from sumo_dist.optim.icem import ImprovedCrossEntropy
from sumo_dist.optim.mppi import PathIntegral
from sumo_dist.optim.optimizer import Belief, Optimizer, coloring, noise_ramp, sample
from sumo_dist.optim.placement import Placement, noise_shares
from sumo_dist.optim.ps import PredictiveSampling

OPTIMIZERS = ("cem", "cma", "icem", "mppi", "ps")

__all__ = [
    "OPTIMIZERS",
    "Belief",
    "Optimizer",
    "Placement",
    "coloring",
    "make_optimizer",
    "noise_ramp",
    "noise_shares",
    "sample",
]


def make_optimizer(name: str, elites: int, temperature: float) -> Optimizer:
    """Build an optimizer; each takes of the parameters what it knows."""
    if name == "cem":
        return CrossEntropy(elites)
    if name == "cma":
        return CovarianceAdaptation()
    if name == "icem":
        return ImprovedCrossEntropy(elites)
    if name == "mppi":
        return PathIntegral(temperature)
    if name == "ps":
        return PredictiveSampling()
    raise unknown("optimizer", name, OPTIMIZERS)
