import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.services import router
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import State

RUN_ROUTER = "import sys; from sumo_dist.services.router import run; run(sys.argv[1])"


@pytest.fixture
def endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def accepts(endpoint: str, host: str = "127.0.0.1") -> bool:
    try:
        socket.create_connection((host, int(endpoint.rpartition(":")[2])), timeout=1.0).close()
    except OSError:
        return False
    return True


def eventually(condition, timeout: float) -> bool:
    deadline = time.monotonic() + timeout
    while not (met := condition()) and time.monotonic() < deadline:
        time.sleep(0.01)
    return bool(met)


@contextmanager
def process(endpoint: str):
    """Run a router in a process of its own."""
    child = subprocess.Popen([sys.executable, "-c", RUN_ROUTER, endpoint])
    try:
        assert eventually(lambda: accepts(endpoint), 30.0)
        yield child
    finally:
        child.kill()
        child.wait()


@contextmanager
def thread(endpoint: str, config=None):
    """Run a router in this process."""
    stop = threading.Event()
    serving = threading.Thread(target=router.serve, args=[endpoint, stop, config])
    serving.start()
    try:
        yield
    finally:
        stop.set()
        serving.join(5.0)
    assert not serving.is_alive()


def test_serves_until_told_to_stop(endpoint):
    with thread(endpoint):
        Bus.dial(endpoint, "spot").close()
    assert not accepts(endpoint)


def test_listens_on_loopback_only(endpoint):
    with thread(endpoint):
        assert eventually(lambda: accepts(endpoint), 20.0)
        assert not accepts(endpoint, "127.0.0.2")  # an address that a wildcard would answer on


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_cleanly(endpoint, end):
    with process(endpoint) as child, Bus.dial(endpoint, "spot"):
        os.kill(child.pid, end)
        assert child.wait(20.0) == 0


def test_a_taken_port_is_one_clear_error(endpoint):
    with thread(endpoint):
        assert eventually(lambda: accepts(endpoint), 20.0)
        with pytest.raises(SumoError, match=f"cannot listen on {endpoint}: the port is taken"):
            router.serve(endpoint)


def test_services_rejoin_a_restarted_router(endpoint):
    with process(endpoint) as first, Bus.dial(endpoint, "spot") as one, Bus.dial(
        endpoint, "spot"
    ) as other:  # fmt: skip
        inbox = other.inbox(State)
        members = one.watch("optimizer")
        member = other.announce("optimizer", "o-1")
        assert eventually(lambda: members.now == {member}, 20.0)

        def heard(tick: int) -> bool:
            one.publish(State("run", tick, np.zeros(51)))
            while not inbox.empty():
                if inbox.get().tick == tick:
                    return True
            return False

        assert eventually(lambda: heard(1), 10.0)
        first.kill()
        first.wait()
        assert eventually(lambda: not members.now, 10.0)
        time.sleep(1.0)  # long enough for the redial interval to reach its maximum
        assert not heard(2)
        with process(endpoint):
            began = time.monotonic()
            assert eventually(lambda: heard(3), 20.0)
            assert eventually(lambda: members.now == {member}, 20.0)
            assert time.monotonic() - began < 10.0


def test_access_rules_of_a_configuration_file_hold(endpoint, tmp_path):
    config = tmp_path / "router.json5"
    config.write_text(
        """{ // nobody may say anything, and the file cannot widen where the router listens
          listen: { endpoints: ["tcp/0.0.0.0:0"] },
          access_control: { enabled: true, default_permission: "deny",
                            rules: [], subjects: [], policies: [] } }"""
    )
    with thread(endpoint, config), Bus.dial(endpoint, "spot") as one:
        assert not accepts(endpoint, "127.0.0.2")
        with Bus.dial(endpoint, "spot") as other:
            slot = other.newest(State)
            one.publish(State("run", 0, np.zeros(51)))
            assert slot.wait(0.3) is None


@pytest.mark.parametrize("text", ["{", "{ no_such_section: 1 }"])
def test_a_broken_configuration_file_is_one_clear_error(endpoint, tmp_path, text):
    config = tmp_path / "router.json5"
    config.write_text(text)
    with pytest.raises(UsageError, match=r"router\.json5 is not a Zenoh configuration"):
        router.serve(endpoint, config=config)


def test_a_missing_configuration_file_is_one_clear_error(endpoint, tmp_path):
    with pytest.raises(UsageError, match="is not a Zenoh configuration"):
        router.serve(endpoint, config=tmp_path / "none.json5")
