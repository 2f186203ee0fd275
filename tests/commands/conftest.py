import socket
import subprocess
import sys

import pytest


@pytest.fixture(scope="session")
def lonely_worker():
    """Start a worker where there is no router; it waits ten seconds for one."""
    dead = "tcp/127.0.0.1:9"
    worker = subprocess.Popen(
        [sys.executable, "-m", "sumo_dist", "rollout-worker", "--connect", dead],
        stderr=subprocess.PIPE,
        text=True,
    )
    yield worker
    worker.kill()
    worker.wait()


@pytest.fixture
def endpoint():
    """Name an endpoint that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"
