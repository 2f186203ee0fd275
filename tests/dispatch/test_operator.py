"""An operator on a real bus: every command is carried out once and answered, however it comes."""

import queue
import threading
import time
from contextlib import ExitStack

import pytest

from sumo_dist.dispatch.operator import REMEMBERED, WAITING, BusOperator
from sumo_dist.episode.command import Controls
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End
from sumo_dist.errors import Interrupted
from sumo_dist.tasks import load_task
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.notices import Ack, CommandMessage


def command(number):
    return CommandMessage("any", number, "tester", "pause", "", "").command


class Ends:
    """The robot's operator, and somebody who gives commands."""

    def __init__(self, stack, endpoint, robot, eventually):
        self.stop, self.arrived, self._eventually = threading.Event(), [], eventually
        bus = stack.enter_context(Bus.dial(endpoint, robot, run="run"))
        self.operator = BusOperator(bus, self.stop, lambda: self.arrived.append(1))
        self.other = stack.enter_context(Bus.dial(endpoint, robot))
        self.acks = self.other.inbox(Ack)
        self._meet()

    def _meet(self):
        """Speak until both ends have heard: what is said before the router knows them is lost."""

        def met():
            self.say(0, "pause", sender="hello")
            time.sleep(0.05)
            for each in self.operator.take(0, 0.0):
                self.operator.answer(each, 0, "")
            return not self.acks.empty()

        assert self._eventually(met, 30.0)
        time.sleep(0.3)
        self.answers()
        self.arrived.clear()

    def say(self, number, verb="pause", name="", value="", sender="tester"):
        self.other.publish(CommandMessage("any", number, sender, verb, name, value))

    def taken(self, count=1):
        """What is taken once as many commands have come."""
        assert self._eventually(lambda: len(self.arrived) >= count, 30.0)
        return [each.number for each in self.operator.take(0, 0.0)]

    def answers(self):
        acks = []
        while not self.acks.empty():
            acks.append(self.acks.get())
        return acks


@pytest.fixture
def ends(router, robot, eventually):
    with ExitStack() as stack:
        yield Ends(stack, router, robot, eventually)


def test_commands_are_taken_in_order_and_once(ends):
    for number in range(5):
        ends.say(number)
    assert ends.taken(5) == [0, 1, 2, 3, 4]
    assert ends.operator.take(0, 0.0) == []


def test_a_command_of_another_run_counts(ends):
    """Who gives it need not know which episode it is."""
    ends.say(1, "weight", "goal", "70")
    assert ends.taken() == [1]


def test_a_command_that_comes_again_is_not_carried_out_again(ends):
    for _ in range(3):
        ends.say(7)
    assert ends.taken(3) == [7]
    ends.say(7)
    assert ends.taken(4) == []
    ends.say(7, sender="another")  # numbers are a sender's own
    ends.say(8)
    assert ends.taken(6) == [7, 8]


def test_the_answer_is_given_again_to_a_command_that_comes_again(ends):
    ends.say(7)
    assert ends.taken() == [7]
    ends.operator.answer(command(7), 12, "no such term")
    first = ends.acks.get(timeout=10.0)
    ends.say(7)
    again = ends.acks.get(timeout=10.0)
    for ack in (first, again):
        assert (ack.run, ack.number, ack.sender) == ("run", 7, "tester")
        assert (ack.tick, ack.refusal) == (12, "no such term")


def test_an_answer_goes_to_its_sender_alone(ends, router, robot):
    with Bus.dial(router, robot) as bus:
        theirs = bus.inbox(Ack, "another")
        ends.operator.answer(command(3), 1, "")
        assert ends.acks.get(timeout=10.0).number == 3
        with pytest.raises(queue.Empty):
            theirs.get(timeout=0.2)


def test_waits_for_a_command_no_longer_than_told(ends):
    began = time.monotonic()
    assert ends.operator.take(0, 0.1) == []
    assert 0.09 < time.monotonic() - began < 5.0
    threading.Timer(0.2, ends.say, [1]).start()
    assert [each.number for each in ends.operator.take(0, 30.0)] == [1]


def test_a_robot_that_is_paused_ends_when_it_is_told_to(ends):
    ends.stop.set()
    assert ends.operator.take(0, 0.0) == []  # it is not paused
    with pytest.raises(Interrupted, match="while it was paused"):
        ends.operator.take(0, 0.05)


def test_a_stop_is_seen_before_it_is_taken(ends, eventually):
    ends.say(1)
    ends.say(2, "stop", value="smoke")
    assert eventually(lambda: len(ends.arrived) == 2)
    assert ends.operator.stop_waits()
    ends.taken(2)
    assert not ends.operator.stop_waits()


def test_too_many_commands_are_dropped_and_may_come_again(ends, eventually):
    for number in range(WAITING + 20):
        ends.say(number)
        if number % 8 == 0:
            time.sleep(0.002)  # a burst would be thinned by the bus
    assert eventually(lambda: len(ends.arrived) >= WAITING, 30.0)
    time.sleep(0.3)
    taken = ends.taken()
    assert len(taken) <= WAITING
    missing = sorted(set(range(WAITING + 20)) - set(taken))
    before = len(ends.arrived)
    ends.say(missing[0])
    assert ends.taken(before + 1) == [missing[0]]


def test_the_memory_of_what_was_carried_out_is_bounded(ends):
    for number in range(REMEMBERED + 50):
        before = len(ends.arrived)
        ends.say(number)
        assert ends.taken(before + 1) == [number]
        ends.operator.answer(command(number), number, "")
    assert len(ends.operator._known) <= REMEMBERED


def test_all_that_comes_with_the_end_of_an_episode_is_answered(ends, eventually):
    """Else who gave it waits in vain: what has come once is not taken again."""
    controls = Controls(EpisodeConfig("spot/move_box"), load_task("spot/move_box"))
    ends.say(1, "weight", "goal", "70")
    ends.say(2, "reset", value="5")
    ends.say(3, "weight", "goal", "80")
    assert eventually(lambda: len(ends.arrived) == 3)
    assert controls.operate(ends.operator, 4).kind is End.REPLACED
    acks = [ends.acks.get(timeout=10.0) for _ in range(3)]
    assert [(ack.number, ack.tick) for ack in acks] == [(1, 4), (2, 4), (3, 4)]
    assert [bool(ack.refusal) for ack in acks] == [False, False, True]
    assert "the episode ends" in acks[2].refusal
    assert [c["number"] for c in controls.commands] == [1, 2]
    assert controls.following.weight == ("goal=70.0",)


def test_a_stop_goes_before_all_that_has_come_with_it(ends, eventually):
    """Even before a reset, whose episode would begin as if nothing had been said."""
    controls = Controls(EpisodeConfig("spot/move_box"), load_task("spot/move_box"))
    ends.say(1, "reset", value="5")
    ends.say(2, "stop", value="smoke")
    ends.say(3, "stop")
    assert eventually(lambda: len(ends.arrived) == 3)
    end = controls.operate(ends.operator, 4)
    assert (end.kind, end.detail) == (End.STOPPED, "tester: smoke")
    assert controls.following is None
    acks = {ack.number: ack.refusal for ack in (ends.acks.get(timeout=10.0) for _ in range(3))}
    assert acks == {1: "the episode ends: stopped by tester: smoke", 2: "", 3: ""}
