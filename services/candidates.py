"""What a plan was chosen from, as a tracer hears it: costs in one message, paths in several."""

from collections.abc import Iterator

import numpy as np

from sumo_dist.planner.report import PlanReport
from sumo_dist.wire.messages import Traces

PATIENCE = 4  # plans by which candidates' paths may lag behind their costs


class Candidates:
    """Joins a plan's costs with its candidates' paths, which come in shards from the workers."""

    def __init__(self) -> None:
        """Start with none."""
        self._plans: dict[int, PlanReport] = {}
        self._shards: dict[int, list[Traces]] = {}

    def add_shard(self, shard: Traces) -> None:
        """Take paths of some candidates of a plan."""
        self._shards.setdefault(shard.number, []).append(shard)
        for number in sorted(self._shards)[: -4 * PATIENCE]:  # of plans that never came
            del self._shards[number]

    def add_plan(self, report: PlanReport) -> None:
        """Take a plan's costs."""
        self._plans[report.plan.number] = report

    def ready(self) -> Iterator[tuple[PlanReport, np.ndarray, np.ndarray]]:
        """Yield each plan whose paths are there, or will hardly come any more, once.

        With it come costs (B,), +inf where a candidate has no path or no cost, and paths
        (B, F, P, 3).
        """
        for number in sorted(self._plans):
            report = self._plans[number]
            drawn, paths = _assemble(len(report.costs), self._shards.get(number, []))
            late = max(self._plans) - number >= PATIENCE
            if late or drawn[report.finite].all():
                del self._plans[number]
                self._shards.pop(number, None)
                if drawn.any():
                    yield report, np.where(drawn & report.finite, report.costs, np.inf), paths


def _assemble(rollouts: int, shards: list[Traces]) -> tuple[np.ndarray, np.ndarray]:
    """Return which candidates have paths, (B,), and all paths, (B, F, P, 3)."""
    drawn = np.zeros(rollouts, bool)
    if not shards:
        return drawn, np.empty(0)
    paths = np.zeros((rollouts, *shards[0].traces.shape[1:]), np.float32)
    for shard in shards:
        rows = slice(shard.start, shard.start + len(shard.traces))
        if rows.stop <= rollouts and shard.traces.shape[1:] == paths.shape[1:]:
            paths[rows], drawn[rows] = shard.traces, True
    return drawn, paths
