"""Which worker rolls out which candidates."""

import heapq
from collections.abc import Mapping

from sumo_dist.dispatch.pace import Pace


def split(start: int, count: int, paces: Mapping[str, Pace]) -> list[tuple[str, int, int]]:
    """Cut rows [start, start + count) into one run of rows a worker, so that all end soonest.

    The rows are given out by as many as a worker has threads, each time to whom would be ready
    with them first. A slow or distant worker so gets fewer, or none.

    Args:
        start: first row.
        count: number of rows.
        paces: of the workers, at least one.

    Returns:
        (worker, first row, rows) for each worker that gets any; together they cover every row once.
    """
    given = dict.fromkeys(paces, 0)
    names = list(paces)
    ready = [(p.ready_ms(p.threads), i) for i, p in enumerate(paces.values())]  # with one more
    heapq.heapify(ready)
    left = count
    while left > 0:
        name = names[ready[0][1]]
        pace = paces[name]
        given[name] += (rows := min(pace.threads, left))
        left -= rows
        heapq.heapreplace(ready, (pace.ready_ms(given[name] + pace.threads), ready[0][1]))
    shards = []
    for name, rows in given.items():
        if rows:
            shards.append((name, start, rows))
            start += rows
    return shards


def chunk(pace: Pace, budget_ms: float, requests: int) -> int:
    """Rows a request, so that a worker that is late with one is late with few.

    Args:
        pace: of the worker.
        budget_ms: time until the answers must be here [ms].
        requests: that the time is cut into.
    """
    fit = int(pace.rows_per_ms * budget_ms / requests)
    return max(1, fit // pace.threads) * pace.threads
