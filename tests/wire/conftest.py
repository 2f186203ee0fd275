import socket

import pytest

from sumo_dist.wire.session import open_router


@pytest.fixture(scope="session")
def free_endpoint():
    """Name an endpoint that nobody listens on."""

    def endpoint() -> str:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            return f"tcp/127.0.0.1:{probe.getsockname()[1]}"

    return endpoint


@pytest.fixture(scope="session")
def router(free_endpoint):
    """Run one router for all tests; each test uses a robot of its own."""
    endpoint = free_endpoint()
    with open_router(endpoint):
        yield endpoint
