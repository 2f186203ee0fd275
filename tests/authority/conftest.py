import pytest

from sumo_dist.authority.store import Authority

ROLES = ["router", "robot", "optimizer", "worker", "tracer", "operator"]


@pytest.fixture
def authority(tmp_path):
    """An authority that has issued keys for one host."""
    made = Authority.found(tmp_path / "keys")
    made.host("r-1", ROLES, ["192.0.2.1"], 30.0)
    return made
