import itertools
import threading
import time
from contextlib import ExitStack

import numpy as np
import pytest

from sumo_dist.dispatch.evaluator import RESEND_S
from sumo_dist.episode.assemble import make_plant
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.rollout import engine_identity
from sumo_dist.services.optimizer import Feed, OptimizerOptions, run
from sumo_dist.tasks import load_task
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import PlanMessage, RolloutReply, RolloutRequest, State, Status

TASK = load_task("spot/move_box")
MEMORY = np.zeros(12, np.float32)


def state(tick):
    return State("run", tick, np.full(64, float(tick)))


def status(tick, wanted=0):
    return Status("run", tick, MEMORY, wanted, "lockstep", 1.0, None)


def realtime(tick, speed):
    return Status("run", tick, MEMORY, -1, "realtime", speed, None)


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
            self.speed = pair[1].speed
            return pair[0].tick
        return None

    def hears(self, tick, speed):
        """Say a realtime status; return the speed that comes out."""
        self.say(state(tick), realtime(tick, speed))
        assert self.pair() == tick
        return self.speed


@pytest.fixture
def ends(router, robot):
    with ExitStack() as stack:
        yield Ends(stack, router, robot)


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


def test_a_speed_counts_once_two_statuses_in_a_row_have_said_it(ends):
    assert [ends.hears(tick, 0.25) for tick in (1, 2)] == [0.0, 0.25]
    assert [ends.hears(tick, speed) for tick, speed in ((3, 1e-300), (4, 0.25))] == [0.25, 0.25]
    assert [ends.hears(tick, speed) for tick, speed in ((5, 1e300), (5, 1e300))] == [0.25, 0.25]
    assert [ends.hears(tick, 0.0) for tick in (6, 7)] == [0.25, 0.0]


class Crew:
    """A realtime optimizer and one worker that loses answers, both on the bus."""

    def __init__(self, stack, endpoint, robot, config):
        self.plans, self.loses, self._stop = [], lambda _asked: False, threading.Event()
        self.bus = stack.enter_context(Bus.dial(endpoint, robot))
        self.bus.subscribe(PlanMessage, lambda _: self.plans.append(time.monotonic()))
        self.bus.subscribe(RolloutRequest, self._answer, address="w")
        self.bus.announce("worker", "w", engine_identity("auto")[1])
        options = OptimizerOptions(TASK.name, endpoint, robot, "run", config)
        self._optimizer = threading.Thread(target=run, args=(options, self._stop))
        self._optimizer.start()
        stack.callback(self._optimizer.join)
        stack.callback(self._stop.set)

    def _answer(self, asked):
        if self.loses(asked):
            return
        rows = len(asked.knots)
        who = (asked.run, asked.worker, asked.number, asked.iteration, asked.shard, asked.start)
        costs = np.zeros((rows, len(TASK.cost))), np.ones(rows, bool)
        self.bus.publish(RolloutReply(*who, *costs, 1.0, ""))


def test_one_status_of_a_tiny_speed_does_not_make_a_plan_wait(router, robot, config):
    """Else a plan whose answers are lost waits for them instead of its deadline."""
    plant = make_plant(EpisodeConfig(TASK.name, 1), TASK)
    with ExitStack() as stack:
        crew = Crew(stack, router, robot, config)
        crew.loses = lambda asked: asked.reply_budget_ms > 1e4
        deadline = time.monotonic() + 60.0
        for tick in itertools.count():
            crew.bus.publish(State("run", tick, np.array(plant.state)))
            crew.bus.publish(realtime(tick, 1e-300 if tick % 7 == 0 else 0.25))
            time.sleep(0.08)
            assert time.monotonic() < deadline
            if len(crew.plans) > 12:
                break
    assert np.diff(crew.plans).max() < RESEND_S
