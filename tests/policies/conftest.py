import pytest

from sumo_dist.policies import load_policy


@pytest.fixture(scope="session")
def spot():
    """The real policy; its weights are fetched once a machine."""
    return load_policy("spot")
