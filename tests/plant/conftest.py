import pytest

from sumo_dist.plant.simulated import Plant


@pytest.fixture(scope="session")
def go():
    """Return a function that sends joint targets to a body and lets a tick pass."""

    def go(body, targets):
        body.send(targets)
        body.advance()

    return go


@pytest.fixture
def plant(move_box, first_state):
    return Plant(move_box.scene, first_state)
