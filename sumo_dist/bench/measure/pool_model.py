"""How long a plan takes on a pool of workers: a model that is fed with measured parts.

Every worker is one core of a host of its own, and has only this planner. A plan's rows are shared
out as `dispatch` does: a run of rows a worker, in realtime in requests of a few rows. Then

    plan = base + max over requests i of (overhead(i) + queue(i) + rollout(rows of i))

    base        of a plan with one request that is answered at once: the question's way, noise,
                update, one message to a worker and back, and the plan's way to the robot
    overhead(i) the optimizer takes one message after the other: by so much later than the first
                one, the i-th request has left or its reply is entered
    queue(i)    what a worker's earlier requests of the plan still take
    rollout(b)  of b rows in one request: the measured median times a factor that is drawn from the
                measured ones. That factor is why the maximum grows with the number of workers.

Nothing is fitted: both come from plans on the real bus, with scripted workers that answer after a
fixed time. The overhead is the processor time of the optimizer's process, as if none of it were in
parallel: the wall time of many such workers is that of their own messages, on the few cores here.
Between the numbers of requests that were measured, and beyond them, the model goes in straight
lines.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sumo_dist.services.optimizer import SEND_MARGIN
from sumo_dist.timing import PLAN_PERIOD

PERIOD_MS = PLAN_PERIOD * 1e3
IN_TIME = 0.99  # share of the rollouts that must be in time if they are to fit
DRAWS = 400  # of a plan


@dataclass(frozen=True)
class RolloutTimes:
    """What a worker takes to roll out the rows of a request.

    Attributes:
        sizes: rows of a request, ascending.
        medians_ms: time of each.
        factors: times of each size over their median, as many as were measured.
    """

    sizes: Sequence[int]
    medians_ms: Sequence[float]
    factors: Sequence[Sequence[float]]

    @classmethod
    def of(cls, samples_ms: Mapping[int, Sequence[float]]) -> "RolloutTimes":
        """Summarise times by size."""
        sizes = sorted(samples_ms)
        medians = [float(np.median(samples_ms[size])) for size in sizes]
        factors = [
            (np.array(samples_ms[size]) / median).tolist()
            for size, median in zip(sizes, medians, strict=True)
        ]
        return cls(sizes, medians, factors)

    @classmethod
    def fixed(cls, ms: float) -> "RolloutTimes":
        """Take the same time for any request."""
        return cls([1, 2], [ms, ms], [[1.0], [1.0]])

    def slowed(self, slowdown: float) -> "RolloutTimes":
        """Take a multiple of the time."""
        return replace(self, medians_ms=[slowdown * ms for ms in self.medians_ms])

    def without_spread(self) -> "RolloutTimes":
        """Take the median always."""
        return replace(self, factors=[[1.0] for _ in self.sizes])

    def median(self, rows: np.ndarray) -> np.ndarray:
        """Median times of requests of so many rows (n,) [ms]."""
        return _on_line(rows, self.sizes, self.medians_ms)

    def draw(self, rows: np.ndarray, draws: int, rng: np.random.Generator) -> np.ndarray:
        """Draw times (draws, n) of requests of so many rows (n,) [ms]."""
        nearest = np.abs(np.subtract.outer(rows, np.array(self.sizes))).argmin(axis=1)
        factors = [rng.choice(self.factors[i], draws) for i in nearest]
        return self.median(rows) * np.stack(factors, axis=1)


@dataclass(frozen=True)
class Parts:
    """What was measured.

    Attributes:
        rollout: of a worker.
        base_ms: of a plan with one request that is answered at once.
        inside_ms: the part of it within the optimizer and beyond, without the way from the robot
            and back.
        requests, overhead_ms: numbers of a plan's requests, ascending from 1, and how much more
            than with the first of them the optimizer has to do with each.
        row_ms: more for each row of a request but its first, by messages alone.
        idle_ms: more for each worker that is there and not asked.
    """

    rollout: RolloutTimes
    base_ms: float
    inside_ms: float
    requests: Sequence[int]
    overhead_ms: Sequence[float]
    row_ms: float
    idle_ms: float

    def overhead(self, requests: np.ndarray) -> np.ndarray:
        """What the optimizer has to do for the others of so many requests (n,) [ms]."""
        return _on_line(requests, self.requests, self.overhead_ms)


@dataclass(frozen=True)
class Prediction:
    """Of one plan, drawn many times.

    Attributes:
        rollouts: of the plan.
        p50_ms, p99_ms: until it is there.
        in_time: mean number of rollouts that would be there in the time that was given.
    """

    rollouts: int
    p50_ms: float
    p99_ms: float
    in_time: float


def requests(workers: int, rollouts: int, chunk: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the worker and the rows of each request of a plan, (n,) both, as they are sent.

    Args:
        workers: equally fast.
        rollouts: of the plan.
        chunk: most rows of a request; None for no limit, as without a deadline.
    """
    ends = np.round(np.linspace(0, rollouts, workers + 1)).astype(int)
    pieces = [
        (worker, min(chunk or count, count - offset))
        for worker, count in enumerate(np.diff(ends).tolist())
        for offset in range(0, count, chunk or max(1, count))
    ]
    whom, rows = np.array(pieces).T
    return whom, rows


def predict(
    parts: Parts, workers: int, rollouts: int, given_ms: float, chunk: int | None = None
) -> Prediction:
    """Predict plans of so many rollouts on so many workers; see the module's docstring."""
    rng = np.random.default_rng(0)
    whom, rows = requests(workers, rollouts, chunk)
    left = parts.overhead(np.arange(len(rows)) + 1) + parts.row_ms * np.cumsum(rows - 1)  # (n,)
    idle = parts.idle_ms * (workers - len(set(whom.tolist())))
    takes = parts.rollout.draw(rows, DRAWS, rng)  # (draws, n)
    ends, free = np.empty_like(takes), np.zeros((DRAWS, workers))
    for i, worker in enumerate(whom):
        ends[:, i] = free[:, worker] = np.maximum(left[i], free[:, worker]) + takes[:, i]
    ends += parts.base_ms + idle
    p50, p99 = np.percentile(ends.max(axis=1), (50, 99))
    in_time = float(((ends <= given_ms) * rows).sum(axis=1).mean())
    return Prediction(rollouts, float(p50), float(p99), in_time)


def free_messages(parts: Parts) -> Parts:
    """Return parts whose messages cost nothing beyond the first request's."""
    return replace(parts, overhead_ms=[0.0] * len(parts.requests), row_ms=0.0, idle_ms=0.0)


def predict_realtime(parts: Parts, workers: int, rollouts: int, chunk: int) -> Prediction:
    """Predict plans with a deadline: as the optimizer sees them, which then sends what it has."""
    within = replace(parts, base_ms=parts.inside_ms)
    return predict(within, workers, rollouts, PERIOD_MS - SEND_MARGIN * 1e3, chunk)


def most_that_fit(parts: Parts, workers: int, chunk: int) -> int:
    """Return the most rollouts of a plan with a deadline of which IN_TIME are in time.

    It is one at least.
    """
    per_worker = PERIOD_MS / float(parts.rollout.median(np.array([chunk]))[0] / chunk)
    least, most = 1, int(2 * workers * max(1.0, per_worker)) + 1
    while most - least > 1:
        middle = (least + most) // 2
        found = predict_realtime(parts, workers, middle, chunk)
        if found.in_time >= IN_TIME * middle:
            least = middle
        else:
            most = middle
    return least


def _on_line(at: np.ndarray, points: Sequence[int], values: Sequence[float]) -> np.ndarray:
    """Interpolate between points, and beyond the last go on as between the last two."""
    if len(points) == 1:
        return np.full(len(at), values[0])
    (before, last), (less, more) = points[-2:], values[-2:]
    beyond = np.maximum(0, at - last) * (more - less) / (last - before)
    return np.interp(at, points, values) + beyond
