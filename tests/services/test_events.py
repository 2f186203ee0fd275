import logging

import pytest

from sumo_dist.wire.bus import Bus
from sumo_dist.wire.events import teller
from sumo_dist.wire.messages import Event


@pytest.mark.parametrize("level", ["info", "warning", "error"])
def test_what_is_told_is_logged_and_published(shared_router, robot, caplog, level):
    with Bus.dial(shared_router, robot) as speaker, Bus.dial(shared_router, robot) as listener:
        inbox = listener.inbox(Event)
        with caplog.at_level(logging.INFO):
            teller(speaker, "run-1", "optimizer")(level, "worker w-1 left")
        event = inbox.get(timeout=5.0)
    assert (event.run, event.source, event.level) == ("run-1", "optimizer", level)
    assert event.text == "worker w-1 left"
    assert ("sumo_dist.optimizer", logging.getLevelName(level.upper()), event.text) in [
        (record.name, record.levelno, record.getMessage()) for record in caplog.records
    ]
