from dataclasses import replace

import pytest

from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import SceneObject


@pytest.fixture(scope="session")
def two_objects(move_box):
    """Spot, its box and a cone, which nobody moves."""
    objects = (*move_box.scene.objects, SceneObject("cone", "objects/cone.xml"))
    frames = {**move_box.frames, "cone": FrameRef("body", "cone")}
    return replace(move_box, scene=replace(move_box.scene, objects=objects), frames=frames)
