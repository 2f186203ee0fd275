"""Telling people: one line in the service's log, and the same as an event for the viewer."""

import logging
from collections.abc import Callable

from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import Event

Tell = Callable[[str, str], None]
"""(level, text); level is "info", "warning" or "error"."""

_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}


def teller(bus: Bus, run: str, source: str) -> Tell:
    """Return the function by which a service speaks to its users during a run."""
    log = logging.getLogger(f"sumo_dist.{source}")

    def tell(level: str, text: str) -> None:
        log.log(_LEVELS[level], text)
        bus.publish(Event(run, source, level, text))  # pyright: ignore[reportArgumentType]

    return tell
