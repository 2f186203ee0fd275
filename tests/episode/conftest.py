import pytest

from sumo_dist.episode.plant import Plant
from sumo_dist.episode.start import draw_start
from sumo_dist.tasks import load_task


@pytest.fixture(scope="session")
def move_box():
    return load_task("spot/move_box")


@pytest.fixture(scope="session")
def first_state(move_box):
    return draw_start(move_box, seed=1)


@pytest.fixture
def plant(move_box, first_state):
    return Plant(move_box.scene, first_state)
