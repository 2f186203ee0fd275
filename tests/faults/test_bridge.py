import time

import numpy as np
import pytest

from sumo_dist.faults.bridge import FaultBridge
from sumo_dist.faults.script import Fault
from sumo_dist.faults.tamper import TAMPERS
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.codec import encode
from sumo_dist.wire.messages import State
from sumo_dist.wire.session import open_router


def state(tick):
    return State("run", tick, np.arange(51.0))


@pytest.fixture
def endpoints(free_endpoint):
    near, far = free_endpoint(), free_endpoint()
    with open_router(near), open_router(far):
        yield near, far


@pytest.fixture
def ends(endpoints, eventually):
    """A bridge, and a service on each of its sides that sees the other."""
    with (
        Bus.dial(endpoints[0], "spot") as here,
        Bus.dial(endpoints[1], "spot") as there,
        FaultBridge(*endpoints, seed=1) as bridge,
    ):
        inbox = there.inbox(State)
        there.announce("receiver", "r")
        members = here.watch("receiver")
        assert eventually(lambda: members.now)
        yield bridge, here, inbox, members


def test_what_no_fault_hits_passes(ends):
    _, here, inbox, _ = ends
    here.publish(state(1))
    assert inbox.get(timeout=3.0).tick == 1


def test_a_cut_link_loses_messages_and_members_and_gives_them_back(ends, eventually):
    bridge, here, inbox, members = ends
    bridge.set_faults(Fault("cut", 0))
    assert eventually(lambda: not members.now)
    here.publish(state(1))
    assert eventually(lambda: bridge.counts["cut"] == 1)
    bridge.set_faults()
    assert eventually(lambda: members.now)
    here.publish(state(2))
    assert inbox.get(timeout=3.0).tick == 2


def test_duplicates_arrive_twice_and_lost_ones_never(ends, eventually):
    bridge, here, inbox, _ = ends
    bridge.set_faults(Fault("duplicate", 0))
    here.publish(state(1))
    assert [inbox.get(timeout=3.0).tick for _ in range(2)] == [1, 1]
    bridge.set_faults(Fault("drop", 0, topics=("state",)))
    here.publish(state(2))
    assert eventually(lambda: bridge.counts["drop"] == 1)
    assert inbox.empty()


def test_a_narrow_link_sends_one_after_another_and_drops_what_would_wait_too_long(ends, eventually):
    bridge, here, inbox, _ = ends
    bits = 8 * len(encode(state(1)))
    bridge.set_faults(Fault("narrow", 0, kbit_s=bits / 1e3 / 0.3))  # 0.3 s a message
    began = time.monotonic()
    for tick in range(6):
        here.publish(state(tick))
    assert [inbox.get(timeout=5.0).tick for _ in range(3)] == [0, 1, 2]
    assert time.monotonic() - began >= 0.9
    assert eventually(lambda: bridge.counts["narrow"] == 6)
    time.sleep(0.5)
    assert inbox.empty()


def test_it_may_end_with_messages_on_their_way(endpoints, eventually, monkeypatch, capfd):
    def slow(payload, _rng):
        time.sleep(0.002)
        return payload

    monkeypatch.setitem(TAMPERS, "garbage", slow)
    with Bus.dial(endpoints[0], "spot") as here:
        with FaultBridge(*endpoints, seed=1) as bridge:
            bridge.set_faults(Fault("garbage", 0))

            def passes():
                for tick in range(100):
                    here.publish(state(tick))
                return bridge.counts["passed"] > 0

            assert eventually(passes)
        passed = bridge.counts["passed"]
        time.sleep(0.3)  # Zenoh hands over the others
    assert bridge.counts["passed"] == passed
    assert "Traceback" not in capfd.readouterr().err
