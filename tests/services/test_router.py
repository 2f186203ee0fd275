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
from sumo_dist.wire.bus import SHOUT, Bus
from sumo_dist.wire.keys import POOL, ROUTER
from sumo_dist.wire.messages import State


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
    child = subprocess.Popen(
        [sys.executable, "-P", "-m", "sumo_dist", "router", "--listen", endpoint]
    )
    try:
        assert eventually(lambda: accepts(endpoint), 30.0)
        yield child
    finally:
        child.kill()
        child.wait()


@contextmanager
def thread(endpoint: str, **options):
    """Run a router in this process."""
    stop = threading.Event()
    serving = threading.Thread(
        target=router.serve, args=[router.RouterOptions(endpoint, **options), stop]
    )
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
            router.serve(router.RouterOptions(endpoint), threading.Event())


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


# Beyond this machine


@pytest.mark.parametrize("host", ["0.0.0.0", "[::]", "192.0.2.1", "robot.example"])
def test_without_keys_it_does_not_listen_beyond_this_machine(host):
    with pytest.raises(UsageError, match=r"owns the robot: listen on tls/.* with --keys DIR"):
        router.RouterOptions(f"tcp/{host}:7447")
    router.RouterOptions(f"tcp/{host}:7447", insecure=True)
    router.RouterOptions(f"tls/{host}:7447")  # the keys are asked for when it starts


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2", "localhost", "[::1]"])
def test_loopback_needs_no_keys(host):
    router.RouterOptions(f"tcp/{host}:7447")


@pytest.mark.parametrize("local", ["tls/127.0.0.1:7448", "tcp/0.0.0.0:7448", "tcp/10.0.0.1:7448"])
def test_the_endpoint_without_keys_is_on_loopback(local):
    with pytest.raises(UsageError, match="local must be on loopback"):
        router.RouterOptions("tls/0.0.0.0:7447", local)


def test_tls_needs_keys(endpoint):
    options = router.RouterOptions(endpoint.replace("tcp", "tls"))
    with pytest.raises(UsageError, match=r"needs --keys DIR, a folder that `sumo-dist keys host`"):
        router.serve(options, threading.Event())


def test_an_insecure_router_is_shouted_about_by_whoever_dials_it(endpoint, caplog):
    everywhere = endpoint.replace("127.0.0.1", "0.0.0.0")
    with thread(everywhere, insecure=True), Bus.dial(endpoint, "spot"), Bus.dial(endpoint, POOL):
        assert eventually(lambda: caplog.text.count(SHOUT) == 2, 20.0)
    assert f"INSECURE: whoever reaches {everywhere} owns the robots here" in caplog.text


def test_nobody_shouts_on_loopback(endpoint, caplog):
    with thread(endpoint), Bus.dial(endpoint, "spot") as bus:
        seen = bus.watch(ROUTER)
        assert eventually(lambda: {member.build for member in seen.now} == {"open"}, 20.0)
    assert "INSECURE" not in caplog.text
