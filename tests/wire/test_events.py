import logging
from contextlib import suppress
from queue import Empty

import pytest

from sumo_dist.wire.bus import Bus
from sumo_dist.wire.events import teller
from sumo_dist.wire.notices import Event


def first_heard(say, inbox):
    """Speak until heard: what is said before the router knows both ends is lost."""
    for _ in range(50):
        say()
        with suppress(Empty):
            return inbox.get(timeout=0.1)
    raise AssertionError("nothing was heard")


@pytest.mark.parametrize("level", ["info", "warning", "error"])
def test_what_is_told_is_logged_and_published(router, robot, caplog, level):
    with Bus.dial(router, robot, run="run-1") as speaker, Bus.dial(router, robot) as listener:
        inbox = listener.inbox(Event)
        with caplog.at_level(logging.INFO):
            tell = teller(speaker, "optimizer")
            event = first_heard(lambda: tell(level, "worker w-1 left"), inbox)
    assert (event.run, event.source, event.level) == ("run-1", "optimizer", level)
    assert event.text == "worker w-1 left"
    assert ("sumo_dist.optimizer", logging.getLevelName(level.upper()), event.text) in [
        (record.name, record.levelno, record.getMessage()) for record in caplog.records
    ]


def test_what_is_told_in_no_run_is_heard_too(router, robot):
    """Such as by an optimizer that no robot has spoken to yet; whatever run a listener is in."""
    with Bus.dial(router, robot) as speaker, Bus.dial(router, robot, run="run-2") as listener:
        inbox = listener.inbox(Event)
        tell = teller(speaker, "optimizer")
        event = first_heard(lambda: tell("info", "worker w-1 joined"), inbox)
    assert (event.run, event.text) == ("", "worker w-1 joined")


def test_what_is_told_belongs_to_the_episode_of_now(router, robot):
    with Bus.dial(router, robot, run="s.1") as speaker, Bus.dial(router, robot) as listener:
        inbox = listener.inbox(Event)
        tell = teller(speaker, "robot")
        assert first_heard(lambda: tell("info", "one"), inbox).run == "s.1"
        speaker.run = "s.2"
        tell("info", "two")
        while (event := inbox.get(timeout=10.0)).text != "two":
            pass  # what was said twice
    assert event.run == "s.2"
