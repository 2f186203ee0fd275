import pytest

from sumo_dist.policies import load_policy


@pytest.fixture(scope="session")
def spot():
    """The real policy; its weights are fetched once a machine."""
    return load_policy("spot")


@pytest.fixture(scope="session", params=["g1", "g1-ppo"])
def g1(request):
    """G1's two policies."""
    return load_policy(request.param)
