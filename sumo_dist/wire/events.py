"""Telling people: one line in the service's log, and the same as an event for the viewer."""

import logging
from collections.abc import Callable
from typing import Literal

from sumo_dist.wire.bus import Bus
from sumo_dist.wire.notices import Event

Level = Literal["info", "warning", "error"]
Tell = Callable[[Level, str], None]
"""(level, text)"""

_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}


def teller(bus: Bus, source: str) -> Tell:
    """Return the function by which a service speaks to its users."""
    log = logging.getLogger(f"sumo_dist.{source}")

    def tell(level: Level, text: str) -> None:
        log.log(_LEVELS[level], text)
        bus.publish(Event(bus.run or "", source, level, text))

    return tell
