import socket
import time

import pytest

from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.tasks import load_task
from sumo_dist.wire.session import open_router

QUICK = PlannerConfig(rollouts=10, horizon=0.4)


def free_endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def endpoint():
    """Name an endpoint that nobody listens on."""
    return free_endpoint()


@pytest.fixture(scope="session")
def shared_router():
    """Run one router for all tests in this process; each test uses a robot of its own."""
    endpoint = free_endpoint()
    with open_router(endpoint):
        yield endpoint


@pytest.fixture
def robot(request):
    return request.node.originalname.replace("_", "-")[:60]


@pytest.fixture(scope="session")
def config():
    return QUICK


@pytest.fixture(scope="session")
def problem(config):
    return Problem.build(load_task("spot/move_box"), planning_options(config))


@pytest.fixture(scope="session")
def eventually():
    def eventually(condition, timeout=5.0):
        """Wait until a condition holds; return whether it does."""
        deadline = time.monotonic() + timeout
        while not (met := condition()) and time.monotonic() < deadline:
            time.sleep(0.005)
        return bool(met)

    return eventually
