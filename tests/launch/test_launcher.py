import os
import signal
import threading
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.launch.launcher import Launcher, Service, dialled, flags, listening
from sumo_dist.launch.serve import Router, Worker
from sumo_dist.wire.bus import Bus


@dataclass(frozen=True)
class Inner:
    rate_hz: float = 2.5
    shown: bool = False


@dataclass(frozen=True)
class Outer:
    name: str = "a name"
    folder: Path = Path("/x")
    limit: float | None = None
    on: bool = True
    inner: Inner = field(default_factory=Inner)


def test_options_become_flags():
    assert list(flags(Outer())) == [
        *("--name", "a name", "--folder", "/x", "--limit", "None", "--on"),
        *("--inner.rate-hz", "2.5", "--inner.no-shown"),
    ]


@pytest.mark.parametrize(
    ("listen", "dial"),
    [
        ("tcp/127.0.0.1:7447", "tcp/127.0.0.1:7447"),
        ("tcp/0.0.0.0:7447", "tcp/127.0.0.1:7447"),
        ("tcp/[::]:7447", "tcp/[::1]:7447"),
        ("tls/planner.lab:7447", "tls/planner.lab:7447"),
    ],
)
def test_a_wildcard_is_dialled_on_this_machine(listen, dial):
    assert dialled(listening(listen)) == dial


def test_port_0_becomes_a_free_one():
    first, second = listening("tcp/127.0.0.1:0"), listening("tcp/0.0.0.0:0")
    assert 1024 <= int(first.rpartition(":")[2]) < 2**16
    assert second.startswith("tcp/0.0.0.0:")
    assert first.rpartition(":")[2] != second.rpartition(":")[2]


@pytest.mark.parametrize("endpoint", ["", "7447", "foo:0", "tcp/127.0.0.1", "udp/127.0.0.1:1"])
def test_what_is_no_endpoint_is_refused(endpoint):
    with pytest.raises(UsageError, match="is not an endpoint; valid: tcp/HOST:PORT"):
        listening(endpoint)


def test_stops_what_it_has_started(endpoint):
    with Launcher() as launcher:
        router = launcher.start(Service("router", "router", Router(endpoint)))
        Bus.dial(endpoint, "spot").close()
        assert router.poll() is None
    assert router.returncode == 0


def test_kills_what_does_not_stop_and_says_so(endpoint, monkeypatch, capfd):
    monkeypatch.setattr("sumo_dist.launch.launcher.STOP_S", 0.3)
    with Launcher() as launcher:
        router = launcher.start(Service("router", "router", Router(endpoint)))
        Bus.dial(endpoint, "spot").close()
        router.send_signal(signal.SIGSTOP)
    assert router.returncode == -signal.SIGKILL
    assert "sumo-dist: router did not end within 0.3 s and was killed" in capfd.readouterr().err


def test_returns_the_exit_code_of_what_it_waits_for(endpoint):
    with Launcher() as launcher:
        wrong = Worker(connect="foo")
        launcher.start(Service("worker", "rollout-worker", wrong))
        assert launcher.wait_for("worker") == 2


def test_the_end_of_a_vital_service_ends_the_run(endpoint):
    with Launcher() as launcher:
        router = launcher.start(Service("router", "router", Router(endpoint)))
        launcher.start(Service("vital", "rollout-worker", Worker(connect="foo")))
        with pytest.raises(SumoError, match="vital ended with exit code 2; see its messages above"):
            launcher.wait_for("router")
    assert router.poll() is not None


def test_the_end_of_another_is_told_once_and_the_run_goes_on(endpoint, capfd):
    with Launcher() as launcher:
        router = launcher.start(Service("router", "router", Router(endpoint)))
        worker = launcher.start(
            Service("local-0", "rollout-worker", Worker(connect=endpoint), vital=False)
        )
        Bus.dial(endpoint, "spot").close()
        worker.kill()
        worker.wait()
        threading.Timer(0.5, router.terminate).start()
        assert launcher.wait_for("router") == 0
    told = "sumo-dist: local-0 ended (SIGKILL), the run goes on"
    assert capfd.readouterr().err.count(told) == 1


def test_ctrl_c_reaches_only_the_launcher(endpoint):
    with Launcher() as launcher:
        router = launcher.start(Service("router", "router", Router(endpoint)))
        assert os.getpgid(router.pid) != os.getpgid(os.getpid())


SLEEPER = ("sh", "-c", 'sleep 60 & exec "$@"', "sh")  # a command with a child of its own


def test_a_prefix_runs_in_the_same_process_and_what_a_killed_service_leaves_is_ended(
    endpoint, eventually
):
    with Launcher() as launcher:
        router = launcher.start(Service("router", "router", Router(endpoint), prefix=SLEEPER))
        Bus.dial(endpoint, "spot").close()
        router.kill()
        router.wait()
        os.killpg(router.pid, 0)  # the sleeper is there
    assert eventually(lambda: not group_lives(router.pid))


def group_lives(leader):
    try:
        os.killpg(leader, 0)
    except ProcessLookupError:
        return False
    return True
