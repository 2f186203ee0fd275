import time
from contextlib import ExitStack

import numpy as np
import pytest

from sumo_dist.services.optimizer import Feed
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import State, Status

MEMORY = np.zeros(12, np.float32)


def state(tick):
    return State("run", tick, np.full(64, float(tick)))


def status(tick, wanted=0):
    return Status("run", tick, MEMORY, wanted, "lockstep", 1.0, None)


def always(status):
    return True


class Ends:
    def __init__(self, stack, endpoint, robot):
        self.other = stack.enter_context(Bus.dial(endpoint, robot))
        self.feed = Feed(stack.enter_context(Bus.dial(endpoint, robot, run="run")))
        self.meet()

    def meet(self):
        """Speak until heard: what is said before the router knows both ends is lost."""
        deadline = time.monotonic() + 5.0
        while self.pair(timeout=0.05) is None:
            assert time.monotonic() < deadline, "the feed hears nothing"
            self.say(state(0), status(0))
        while self.pair(timeout=0.05) is not None:
            pass  # what was said twice

    def say(self, *messages):
        for message in messages:
            self.other.publish(message)

    def pair(self, wanted=always, timeout=2.0):
        pair = self.feed.wait(wanted, timeout)
        if pair is not None:
            assert pair[0].tick == pair[1].tick
            return pair[0].tick
        return None


@pytest.fixture
def ends(shared_router, robot):
    with ExitStack() as stack:
        yield Ends(stack, shared_router, robot)


@pytest.mark.parametrize("order", [(state(4), status(4)), (status(4), state(4))])
def test_a_status_waits_for_the_state_of_its_tick(ends, order):
    first, second = order
    ends.say(state(3), first)
    assert ends.pair(timeout=0.1) is None
    ends.say(second)
    assert ends.pair() == 4


def test_a_pair_is_handed_out_once_and_again_when_asked_again(ends):
    ends.say(state(4), status(4))
    assert ends.pair() == 4
    assert ends.pair(timeout=0.05) is None
    ends.say(status(4))  # the robot has missed the answer
    assert ends.pair() == 4


def test_only_the_newest_pair_counts(ends):
    ends.say(state(4), status(4), state(5), status(5))
    time.sleep(0.1)
    assert ends.pair() == 5
    assert ends.pair(timeout=0.05) is None


def test_what_is_not_wanted_is_kept_until_it_is(ends):
    ends.say(state(4), status(4, wanted=-1))
    assert ends.pair(lambda s: s.wanted >= 0, timeout=0.1) is None
    assert ends.pair() == 4


def test_old_states_are_forgotten(ends):
    ends.say(*(state(tick) for tick in range(30)))
    time.sleep(0.1)  # another thread takes the status
    ends.say(status(2))
    assert ends.pair(timeout=0.1) is None
