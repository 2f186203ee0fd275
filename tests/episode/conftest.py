import pytest

from sumo_dist.plant.simulated import Plant


@pytest.fixture
def plant(move_box, first_state):
    return Plant(move_box.scene, first_state)
