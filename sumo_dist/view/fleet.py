"""The pool of rollout workers in numbers: how many, how fast, and what messages were lost."""

import numpy as np

from sumo_dist.view.plots import PlotLog

LOST = "dropped "  # begins the names of counters of lost messages, see `wire.health`
NO_LOSS = "dropped run"  # messages of another run, which nobody misses


class Fleet:
    """Keeps what was told last of each worker and service."""

    def __init__(self, plots: PlotLog) -> None:
        """Start with nobody."""
        self._plots = plots
        self._alive = 0
        self._paces: dict[str, tuple[str, float]] = {}  # state, rollouts per second
        self._dropped: dict[str, dict[str, float]] = {}  # by service and reason
        self._gone = 0.0  # messages lost by workers that are no more

    def set_alive(self, alive: int) -> None:
        """Take note of how many workers there are."""
        self._alive = alive

    def add_worker(self, name: str, state: str, rollouts_per_s: float) -> None:
        """Take note of how a worker is."""
        self._paces[name] = state, rollouts_per_s

    def remove_worker(self, name: str) -> None:
        """Take note that a worker has gone."""
        self._paces.pop(name, None)
        self._gone += sum(self._dropped.pop(name, {}).values())

    def count(self, source: str, name: str, value: float | str) -> None:
        """Take note of a service's counter."""
        if name.startswith(LOST) and name != NO_LOSS and not isinstance(value, str):
            self._dropped.setdefault(source, {})[name] = value

    def log(self, tick: int, dropped_here: int) -> None:
        """Plot it at a tick; so many messages were not shown because there were too many."""
        paces = [pace for state, pace in self._paces.values() if state == "answers"]
        if paces:
            self._plots.add("pace", tick, [max(paces), float(np.median(paces)), min(paces)])
        self._plots.add("workers", tick, [len(paces), self._alive])
        lost = {name: sum(reasons.values()) for name, reasons in self._dropped.items()}
        workers = sum(lost.pop(name) for name in list(lost) if name in self._paces)
        shown = sum(lost.values()), workers + self._gone, dropped_here
        self._plots.add("dropped", tick, shown)
