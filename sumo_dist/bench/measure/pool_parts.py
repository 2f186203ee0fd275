"""Measuring what `pool_model` is fed with: rollouts in this process, messages on the real bus."""

import time
from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np

from sumo_dist.bench.measure.planning import request
from sumo_dist.bench.measure.pool_bench import Bench, Made
from sumo_dist.bench.measure.pool_model import Parts, RolloutTimes
from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.episode.assemble import Episode
from sumo_dist.planner.evaluate import Evaluation, Evaluator
from sumo_dist.planner.planner import Planner, PlanRequest
from sumo_dist.terminal import say

SIZES = (1, 2, 4, 8, 16, 32)  # rows of a request whose rollout is timed
DELAY_MS = 60.0  # of scripted workers whose messages are timed: all are asked before one answers
FEW = 8  # workers that plans with more rows a request, and with idle workers, are timed with
MANY_ROWS = 8  # of such a request
REST = 0.15  # after a rollout, as a share of its time


def overheads(bench: Bench, workers: Sequence[int]) -> dict[tuple[int, int], Made]:
    """Time plans by (workers, rollouts) with workers that all answer after the same time.

    A row each for all numbers of workers; and for a few of them, more rows, and more workers that
    are not asked. All are timed upwards and again downwards: what drifts counts for all alike.
    """
    few, most = min(FEW, max(workers)), max(workers)
    counts = sorted({1, few, *workers})
    found: dict[tuple[int, int], Made] = {}
    for count in (*counts, *reversed(counts)):
        wanted = {count, *([MANY_ROWS * few] if count == few else []), *([few] * (count == most))}
        with bench.scripted(count, RolloutTimes.fixed(DELAY_MS)):
            for rollouts in sorted(wanted):
                kind = count, rollouts
                found[kind] = bench.timed(*kind).plus(found.get(kind))
        say(f"plans of {count} workers timed")
    return found


def parts(rollout: RolloutTimes, found: Mapping[tuple[int, int], Made]) -> Parts:
    """Return what the model needs, from rollout times and what `overheads` returns."""
    took = {kind: made.median_ms - DELAY_MS for kind, made in found.items()}
    counts = sorted({workers for workers, _ in found})
    few, most = min(FEW, counts[-1]), counts[-1]
    more_rows = took[few, MANY_ROWS * few] - took[few, few]
    idle = took[most, few] - took[few, few]
    own = [found[count, count].optimizer_cpu_ms - found[1, 1].optimizer_cpu_ms for count in counts]
    return Parts(
        rollout,
        base_ms=took[1, 1],
        inside_ms=float(np.median(found[1, 1].inside_ms)) - DELAY_MS,
        requests=counts,
        overhead_ms=np.maximum.accumulate(own).tolist(),
        row_ms=max(0.0, more_rows) / (few * (MANY_ROWS - 1)),
        idle_ms=max(0.0, idle) / max(1, most - few),
    )


class RolloutTimer:
    """Times rollouts on one thread of this process. A context manager."""

    def __init__(self, episode: Episode, snapshot: Snapshot, engine: str) -> None:
        """Plan from a snapshot."""
        self._episode, self._snapshot = episode, snapshot
        config = episode.controls.planner
        self._planner = Planner(config, episode.task.actions, episode.config.seed)
        self._engine = episode.problem.engine(1, engine)
        self._evaluator = Evaluator(episode.problem, self._engine, config)
        self._number = 0
        self._took_ms = 0.0
        for size in SIZES:  # the first are slow
            self(size)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.close()

    def __call__(self, size: int) -> float:
        """Return the processor time of a request of so many rows [ms]: what it takes undisturbed.

        Then rest: the kernel holds up what has real-time priority and is never idle.
        """
        self._number += 1
        asked = request(self._episode, self._snapshot, self._number)
        self._planner.plan(asked, self._evaluate, size)
        time.sleep(REST * self._took_ms * 1e-3)
        return self._took_ms

    def _evaluate(self, asked: PlanRequest, _: int, knots: np.ndarray) -> Evaluation:
        began = time.process_time()
        found = self._evaluator(asked.state, asked.memory, asked.cost.parameters, knots)
        self._took_ms = (time.process_time() - began) * 1e3
        return found

    def times(self, repeats: int) -> RolloutTimes:
        """Time all sizes in turn."""
        samples: dict[int, list[float]] = {size: [] for size in SIZES}
        for _ in range(repeats):
            for size, of_it in samples.items():
                of_it.append(self(size))
        return RolloutTimes.of(samples)
