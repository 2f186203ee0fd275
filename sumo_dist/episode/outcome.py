"""What came of an episode from an instant on, in one line."""

import numpy as np

from sumo_dist.episode.ending import End
from sumo_dist.record.recording import Recording
from sumo_dist.timing import TICK


def outcome(recording: Recording, tick: int, weights: np.ndarray | None = None) -> str:
    """Say how an episode ended, when, and what its plans cost from a tick on.

    A plan costs what its candidate without noise does. The costs are means over the plans.

    Args:
        recording: of the episode.
        tick: from which on plans count.
        weights: (n_terms,) at which the costs are told, so that two episodes compare; by default
            those that each plan was made with. A term whose own weight was 0 is unknown then.
    """
    seconds = (len(recording.states) - 1) * TICK
    if recording.ending == End.SUCCESS:
        ended = f"solved at {seconds:.2f} s"
    else:
        ended = f"not solved: {recording.ending or 'it ends'}, at {seconds:.2f} s"
    later = np.asarray(recording.plan_ticks) >= tick
    if not later.any():
        return f"{ended}; no plan later"
    terms = np.array(recording.terms)[later]  # (plans, n_terms)
    if weights is not None:
        own = np.array(recording.weights)[later]
        with np.errstate(divide="ignore", invalid="ignore"):
            terms = np.where(own == weights, terms, terms / own * weights)
    means = terms.mean(axis=0)
    names = recording.config["terms"]
    each = ", ".join(
        f"{name} {mean:.1f}" if np.isfinite(mean) else f"{name} unknown"
        for name, mean in zip(names, means, strict=True)
    )
    return f"{ended}; mean cost {np.nansum(means):.1f} ({each})"


def weights_at(recording: Recording, tick: int) -> np.ndarray | None:
    """Weights (n_terms,) of the first plan from a tick on; None if there is none."""
    later = np.flatnonzero(np.asarray(recording.plan_ticks) >= tick)
    return np.asarray(recording.weights[int(later[0])]) if len(later) else None
