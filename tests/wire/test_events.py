import logging
from contextlib import suppress
from queue import Empty

import pytest

from sumo_dist.wire.bus import Bus
from sumo_dist.wire.events import teller
from sumo_dist.wire.messages import Event


def first_heard(say, inbox):
    """Speak until heard: what is said before the router knows both ends is lost."""
    for _ in range(50):
        say()
        with suppress(Empty):
            return inbox.get(timeout=0.1)
    raise AssertionError("nothing was heard")


@pytest.mark.parametrize("level", ["info", "warning", "error"])
def test_what_is_told_is_logged_and_published(router, robot, caplog, level):
    with Bus.dial(router, robot) as speaker, Bus.dial(router, robot) as listener:
        inbox = listener.inbox(Event)
        with caplog.at_level(logging.INFO):
            tell = teller(speaker, "run-1", "optimizer")
            event = first_heard(lambda: tell(level, "worker w-1 left"), inbox)
    assert (event.run, event.source, event.level) == ("run-1", "optimizer", level)
    assert event.text == "worker w-1 left"
    assert ("sumo_dist.optimizer", logging.getLevelName(level.upper()), event.text) in [
        (record.name, record.levelno, record.getMessage()) for record in caplog.records
    ]
