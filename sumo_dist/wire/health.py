"""A service's heartbeat: a few times a second it says how it is, to whoever watches."""

import threading
from collections.abc import Callable, Mapping
from typing import Self

from sumo_dist.errors import SumoError
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.notices import Health

PERIOD_S = 0.5

Counters = Mapping[str, int | float | str]
Probe = Callable[[], tuple[str, Counters]]
"""-> one word for what the service does, and its counters by name"""


class Heartbeat:
    """Publishes a service's health until it is left. The messages it dropped are counted along."""

    def __init__(
        self, bus: Bus, source: str, probe: Probe, more: Callable[[], None] = lambda: None
    ) -> None:
        """Speak for a service.

        Args:
            bus: its bus.
            source: its name.
            probe: says how it is; called on a thread of its own.
            more: publishes what else it tells each time, on the same thread.
        """
        self._bus, self._source, self._probe, self._more = bus, source, probe, more
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._beat, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Speak once more and stop."""
        self._over.set()
        self._thread.join()

    def _beat(self) -> None:
        over = False
        while not over:
            over = self._over.wait(PERIOD_S)
            mode, counters = self._probe()
            dropped = {f"dropped {reason}": n for reason, n in dict(self._bus.rejected).items()}
            try:
                run = self._bus.run or ""
                self._bus.publish(Health(run, self._source, mode, {**counters, **dropped}))
                self._more()
            except SumoError:  # the bus is being closed
                return
