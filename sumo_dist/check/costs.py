"""Checks of a task's cost terms on random plans, the objects tilted and set in motion."""

import numpy as np

from sumo_dist.check.findings import Finding, verdict
from sumo_dist.check.subject import NUDGES, PLANS, Subject
from sumo_dist.costs.terms import INDICATORS

SAY = 1e-4  # a term whose spread is a smaller part of the largest one's decides nothing
LARGEST = 1e6  # a weighted term beyond this has a weight or a unit that cannot be meant


def finite(subject: Subject) -> Finding:
    """Are all costs finite and of a size that can be meant."""
    for i, term in enumerate(subject.task.cost):
        values = subject.terms[:, :, i]
        if not np.isfinite(values).all():
            lost = np.count_nonzero(~np.isfinite(values))
            return Finding("fail", f"{term.name} is not finite in {lost} of {values.size} rollouts")
        if (largest := np.abs(values).max()) > LARGEST:
            return Finding("fail", f"{term.name} reaches {largest:.1e}: look at its weight or unit")
    means = zip(subject.task.cost, subject.terms.mean(axis=(0, 1)), strict=True)
    return Finding("ok", "mean " + ", ".join(f"{term.name} {mean:.3g}" for term, mean in means))


def sensitive(subject: Subject) -> Finding:
    """Does every term tell apart what may come of one start, and have a say in the sum."""
    spreads = subject.terms.std(axis=1).mean(axis=0)  # (n_terms,)
    idle, unmoved = [], []
    for i, (term, spread) in enumerate(zip(subject.task.cost, spreads, strict=True)):
        if spread > SAY * spreads.max():
            continue
        if term.reduction in INDICATORS:  # which may well be of something rare
            idle.append(term.name)
        elif np.ptp(subject.terms[:, :, i]) == 0.0:
            unmoved.append(term.name)
        else:
            return Finding(
                "fail",
                f"{term.name} varies by {spread:.1e} over nudges and random plans, others up to "
                f"{spreads.max():.1e}: it decides nothing",
            )
    told = zip(subject.task.cost, spreads, strict=True)
    text = "spread " + ", ".join(f"{term.name} {spread:.3g}" for term, spread in told)
    if idle:
        text += f"; not seen: {', '.join(idle)}"
    if unmoved:
        text += f"; the same whatever was tried, so of use later or never: {', '.join(unmoved)}"
    return Finding("warn" if unmoved else "ok", text)


def split(subject: Subject) -> Finding:
    """Are the costs of a batch the same, bit for bit, when it is split."""
    rng = np.random.default_rng(1)
    jobs = [
        (subject.nudged(subject.starts[0], rng), subject.knots(PLANS, rng)) for _ in range(NUDGES)
    ]
    starts = np.repeat([state for state, _ in jobs], PLANS, axis=0)  # of every row of one batch
    with subject.problem.engine(1) as one, subject.problem.engine(2) as two:
        whole, parts = subject.evaluator(one), subject.evaluator(two)
        together = subject.costs(whole, starts, np.concatenate([knots for _, knots in jobs]))
        pieces = [
            subject.costs(parts, state, rows)
            for state, knots in jobs
            for rows in np.split(knots, [1, 3])
        ]
    apart = np.concatenate(pieces)
    same = (together == apart).all(axis=0)
    differing = [t.name for t, equal in zip(subject.task.cost, same, strict=True) if not equal]
    text = (
        f"{len(apart)} rollouts together, and in {len(pieces)} parts on another number of threads"
    )
    reason = f"{', '.join(differing)} depends on the other rows: avoid batched matrix products"
    return verdict(not differing, text, reason)
