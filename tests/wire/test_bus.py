import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from queue import Empty

import numpy as np
import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.wire import bus as bus_module
from sumo_dist.wire.bus import Bus, Newest
from sumo_dist.wire.codec import encode, seal, unseal
from sumo_dist.wire.keys import POOL, SCHEMA, Member, alive_key, topic_key
from sumo_dist.wire.messages import EpisodeInfo, RolloutReply, State
from sumo_dist.wire.notices import Ack, CommandMessage
from sumo_dist.wire.session import open_client, open_router

STATE = np.arange(51.0)


def state(tick: int, run: str = "run") -> State:
    return State(run, tick, STATE)


def reply(asker: str, number: int) -> RolloutReply:
    return RolloutReply(
        "run", "w-1", asker, number, 0, 0, 0, np.ones((4, 3)), np.ones(4, bool), 1.0, "", False
    )


def eventually(condition, timeout: float = 15.0) -> bool:
    deadline = time.monotonic() + timeout
    while not (met := condition()) and time.monotonic() < deadline:
        time.sleep(0.01)
    return bool(met)


@pytest.fixture
def pair(router, request):
    """Two services on the bus of a robot that no other test uses."""
    robot = request.node.originalname.replace("_", "-")
    with Bus.dial(router, robot) as one, Bus.dial(router, robot) as other:
        yield one, other


def listening(receiver: Bus, sender: Bus) -> None:
    """Wait until what the receiver has subscribed to is known to the sender."""
    receiver.announce("receiver", "r")
    members = sender.watch("receiver")
    assert eventually(lambda: members.now)


@pytest.fixture
def raw(router):
    """Put any bytes on any key."""
    with open_client(router, 3.0) as session:
        yield session


def test_messages_arrive_in_order(pair):
    sender, receiver = pair
    inbox = receiver.inbox(State)
    listening(receiver, sender)
    for tick in range(50):
        sender.publish(state(tick))
    received = [inbox.get(timeout=10.0) for _ in range(50)]
    assert [m.tick for m in received] == list(range(50))
    np.testing.assert_array_equal(received[-1].state, STATE)


def test_an_addressed_topic_reaches_one_or_all(pair):
    sender, receiver = pair
    of_one, of_all = receiver.inbox(RolloutReply, "o-1"), receiver.inbox(RolloutReply)
    listening(receiver, sender)
    for asker in ("o-1", "o-2"):
        sender.publish(reply(asker, 0))
    assert {of_all.get(timeout=10.0).asker for _ in range(2)} == {"o-1", "o-2"}
    assert of_one.get(timeout=10.0).asker == "o-1"
    with pytest.raises(Empty):
        of_one.get(timeout=0.1)


def test_newest_holds_the_newest_and_drops_the_stale(pair):
    sender, receiver = pair
    slot = receiver.newest(State)
    assert slot.peek() is None and slot.wait(0.01) is None
    listening(receiver, sender)
    for tick in (1, 5, 3):
        sender.publish(state(tick))
    assert eventually(lambda: receiver.rejected["stale"] == 1)
    message = slot.wait(1.0)
    assert message is not None and message.tick == 5
    assert slot.wait(0.01) is None and slot.peek() is message


def test_a_slot_takes_a_repeated_message_and_a_new_run():
    slot = Newest()
    assert slot.put(state(7)) and slot.wait(0.0).tick == 7
    assert slot.put(state(7)) and slot.wait(0.0).tick == 7
    assert not slot.put(state(6))
    assert slot.put(state(0, "next run")) and slot.wait(0.0).tick == 0


def test_a_slot_wakes_the_waiting_thread(pair):
    sender, receiver = pair
    slot = receiver.newest(State)
    listening(receiver, sender)
    timer = threading.Timer(0.05, sender.publish, [state(1)])
    timer.start()
    began = time.monotonic()
    assert slot.wait(60.0) is not None
    assert time.monotonic() - began < 30.0
    timer.join()


def test_other_runs_are_dropped_and_counted(pair):
    sender, receiver = pair
    receiver.run = "mine"
    inbox = receiver.inbox(State)
    listening(receiver, sender)
    sender.publish(state(1, "theirs"))
    sender.publish(state(2, "mine"))
    assert inbox.get(timeout=10.0).tick == 2
    assert receiver.rejected == {"run": 1}


def test_what_any_run_may_say_is_heard_in_every_run(pair):
    sender, receiver = pair
    receiver.run = "mine"
    infos, commands = receiver.inbox(EpisodeInfo), receiver.inbox(CommandMessage)
    listening(receiver, sender)
    sender.publish(EpisodeInfo("theirs", "{}", "hash", 1))
    sender.publish(CommandMessage("", 0, "tester", "pause", "", ""))
    assert infos.get(timeout=10.0).run == "theirs"
    assert commands.get(timeout=10.0).verb == "pause"
    assert not receiver.rejected


def test_an_answer_reaches_who_asked(pair):
    sender, receiver = pair
    mine = receiver.inbox(Ack, "me")
    listening(receiver, sender)
    for who in ("somebody", "me"):
        sender.publish(Ack("run", 0, who, 3, ""))
    assert mine.get(timeout=10.0).sender == "me"
    with pytest.raises(Empty):
        mine.get(timeout=0.1)


def test_malformed_messages_are_counted_by_reason(pair, raw, caplog):
    sender, receiver = pair
    inbox = receiver.inbox(State)
    key = topic_key("test-malformed-messages-are-counted-by-reason", "state")
    payload = encode(state(1))
    wrong = seal(unseal(payload).replace(b"\xa1v" + bytes([SCHEMA]), b"\xa1v\x63"))
    listening(receiver, sender)
    for junk in (b"", b"junk", payload[:-1], payload[:-1], wrong, encode(reply("w", 1))):
        raw.put(key, junk)
    raw.put(key, payload)
    assert inbox.get(timeout=10.0).tick == 1
    assert receiver.rejected == {"checksum": 4, "version": 1, "type": 1}
    assert len([r for r in caplog.records if "(checksum;" in r.message]) == 1


def test_a_full_inbox_drops_and_counts(pair, monkeypatch):
    monkeypatch.setattr(bus_module, "INBOX_LIMIT", 3)
    sender, receiver = pair
    inbox = receiver.inbox(State)
    listening(receiver, sender)
    for tick in range(5):
        sender.publish(state(tick))
    assert eventually(lambda: receiver.rejected["overflow"] == 2)
    assert inbox.qsize() == 3


def test_an_error_in_a_callback_does_not_end_the_subscription(pair, caplog):
    sender, receiver = pair
    received = []

    def clumsy(message: State) -> None:
        received.append(message.tick)
        raise ValueError("clumsy")

    receiver.subscribe(State, clumsy)
    listening(receiver, sender)
    for tick in range(3):
        sender.publish(state(tick))
    assert eventually(lambda: received == [0, 1, 2])


def test_members_are_seen_whether_they_came_before_or_after(pair, router):
    watcher, _ = pair
    robot = "test-members-are-seen-whether-they-came-before-or-after"
    changes = []
    with Bus.dial(router, robot) as early:
        first = early.announce("worker", "w-1", "avx2/4.0")
        members = watcher.watch("worker", lambda m, joined: changes.append((m.id, joined)))
        everybody = watcher.watch()
        assert eventually(lambda: members.now == {first})
        with Bus.dial(router, robot) as late:
            second = late.announce("worker", "w-2")
            late.announce("optimizer", "o-1")
            assert eventually(lambda: members.now == {first, second})
            assert eventually(lambda: len(everybody.now) == 3)
        assert eventually(lambda: members.now == {first})
    assert eventually(lambda: not members.now and not everybody.now)
    assert changes == [("w-1", True), ("w-2", True), ("w-2", False), ("w-1", False)]


def test_members_of_other_versions_are_seen(pair, raw):
    watcher, _ = pair
    foreign = Member("worker", "old", SCHEMA + 1, "a build")
    token = raw.liveliness().declare_token(alive_key(POOL, foreign))
    members = watcher.watch("worker")
    assert eventually(lambda: members.now == {foreign})
    token.undeclare()
    assert eventually(lambda: not members.now)


def test_robots_do_not_hear_each_other(pair, router):
    sender, _ = pair
    with Bus.dial(router, "another-robot") as other:
        inbox = other.inbox(State)
        members = other.watch()
        sender.announce("optimizer", "o-1")
        sender.publish(state(1))
        with pytest.raises(Empty):
            inbox.get(timeout=0.2)
        assert not members.now


def test_no_router_is_one_clear_error(free_endpoint):
    endpoint = free_endpoint()
    began = time.monotonic()
    with pytest.raises(SumoError, match=f"no router at {endpoint}.*sumo-dist router --listen"):
        Bus.dial(endpoint, "spot", timeout=0.3)
    assert time.monotonic() - began < 10.0  # not Zenoh's own patience


def test_dialling_waits_for_the_router(free_endpoint):
    endpoint = free_endpoint()
    with ExitStack() as stack:
        late = threading.Timer(0.3, lambda: stack.enter_context(open_router(endpoint)))
        late.start()
        with Bus.dial(endpoint, "spot", timeout=10.0) as bus:
            bus.publish(state(0))
        late.join()


@pytest.mark.parametrize(
    "endpoint",
    ["", "127.0.0.1:7447", "tcp/127.0.0.1", "tcp/127.0.0.1:0", "tcp/a:65536", "smoke/a:1"],
)
def test_bad_endpoints_name_the_form(endpoint):
    with pytest.raises(UsageError, match="valid: tcp/HOST:PORT"):
        Bus.dial(endpoint, "spot")


def test_bad_names_are_refused_before_dialling(free_endpoint):
    with pytest.raises(UsageError, match="robot 'a/b' is not a valid name"):
        Bus.dial(free_endpoint(), "a/b")


def test_a_closed_bus_says_so(router):
    bus = Bus.dial(router, "closing")
    bus.close()
    bus.close()
    with pytest.raises(SumoError, match="cannot publish State"):
        bus.publish(state(1))


LEAVING = """
import sys, threading, time
import numpy as np
from sumo_dist.errors import SumoError
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import State

def chatter(bus):
    try:
        while True:
            bus.publish(State("run", 0, np.zeros(51)))
    except SumoError:
        pass

with Bus.dial(sys.argv[1], "leaving") as bus:
    bus.announce("optimizer", "o-1")
    bus.watch()
    slot, inbox = bus.newest(State), bus.inbox(State)
    bus.subscribe(State, lambda message: time.sleep(0.05))  # leaves a backlog
    threading.Thread(target=chatter, args=[bus]).start()
    slot.wait(5.0)
    time.sleep(0.3)
    if sys.argv[2] == "raise":
        raise SystemExit(3)
"""


@pytest.mark.parametrize(("ending", "code"), [("return", 0), ("raise", 3)])
def test_a_process_leaves_promptly_under_traffic(router, ending, code):
    began = time.monotonic()
    process = subprocess.run(
        [sys.executable, "-c", LEAVING, router, ending], timeout=60, check=False
    )
    assert process.returncode == code
    assert time.monotonic() - began < 20.0
