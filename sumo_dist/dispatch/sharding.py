"""Which worker rolls out which candidates."""

from collections.abc import Mapping

import numpy as np


def split(start: int, count: int, speeds: Mapping[str, float]) -> list[tuple[str, int, int]]:
    """Cut rows [start, start + count) into one run of rows a worker, in proportion to speed.

    Args:
        start: first row.
        count: number of rows.
        speeds: rows per unit of time of each worker, positive.

    Returns:
        (worker, first row, rows) for each worker that gets any; together they cover every row once.
    """
    shares = np.array(list(speeds.values()), float)
    bounds = np.round(np.concatenate([[0.0], np.cumsum(shares / shares.sum())]) * count).astype(int)
    return [
        (worker, start + int(low), int(high - low))
        for worker, low, high in zip(speeds, bounds[:-1], bounds[1:], strict=True)
        if high > low
    ]
