import numpy as np
import pytest

from sumo_dist.costs.view import Frame, View
from sumo_dist.episode.assemble import draw_start
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model


@pytest.fixture(scope="session")
def plant_model(move_box):
    return compile_model(move_box.scene, PLANT)


@pytest.fixture(scope="session")
def index(plant_model):
    return StateIndex(plant_model)


@pytest.fixture(scope="session")
def starts(move_box):
    """The first states of 200 seeds."""
    return [draw_start(move_box, seed) for seed in range(200)]


@pytest.fixture(scope="session")
def synthetic(move_box):
    """Build a view of one rollout from the paths of object and gripper, each (T, 3), and texts."""

    table = move_box.table

    def build(p_obj, p_grip, v_obj, *param):
        still = np.zeros_like(v_obj)
        rot = np.broadcast_to(np.eye(3), (1, len(p_obj), 3, 3))
        velocity = np.concatenate([v_obj, still], axis=1)[None]
        frames = {
            "object": Frame("object", p_obj[None], rot, velocity),
            "aim": Frame("aim", p_obj[None], rot, velocity),
            "gripper": Frame("gripper", p_grip[None], rot),
            "base": Frame("base", np.full((1, len(p_obj), 3), 0.5), rot),  # it stands
        }
        parameters = table.named(table.adjusted((), param).parameters)
        return View(frames, np.zeros((1, len(p_obj), 9)), parameters)

    return build
