"""A scene without its robot: what stays, and what is said of what does not."""

import re

import numpy as np
import pytest

from sumo_dist.check.world import World
from sumo_dist.model.scene import Scene, SceneObject
from sumo_dist.robots.spot import SPOT
from sumo_dist.tasks.reset import Start

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
CUBE = '<geom type="box" size=".1 .1 .1" mass="1" {}/>'
POLE = '<geom type="capsule" size=".05 .4" mass="1"/>'
SLOPE = '<geom type="box" size="2 2 .1" pos="0 0 -.1" euler="0 50 0" friction=".1" priority="9"/>'


def scene(folder, inside, fixtures=""):
    """Spot and a body with one geom, among fixtures if there are any."""
    names = {"it": f'<body name="it">{inside}</body>', "slope": f"<body>{fixtures}</body>"}
    for name, body in names.items():
        (folder / f"{name}.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    things = [SceneObject(name, str(folder / f"{name}.xml")) for name in names]
    return Scene(SPOT, (things[0],), (things[1],) if fixtures else ())


def settled(scene, z, velocity=0.0):
    """Put the body at a height, with a velocity along x; return what came of it."""
    start = Start.of(scene)
    state = start.place(np.array([5.0, 0.0]), 0.0, {"it": (np.array([0.0, 0.0, z]), LEVEL)})
    state[start.index.velocity("it")][0] = velocity
    return state, World(scene, start.model).settle(state)


@pytest.mark.parametrize(
    ("inside", "z", "said"),
    [
        (CUBE.format(""), 0.1, ""),
        (CUBE.format(""), 0.105, ""),
        (CUBE.format(""), 0.15, "it drops by 50 mm before it rests: it is put too high"),
        (CUBE.format(""), 0.07, "it rises by 30 mm: it is put into what it stands on"),
        (CUBE.format('contype="4" conaffinity="4"'), 0.1, "it falls for ever: none of its geoms"),
        (POLE, 0.45, "it (tips|drops) by"),
    ],
)
def test_what_does_not_stay_is_told(tmp_path, inside, z, said):
    state, rest = settled(scene(tmp_path, inside), z)
    assert re.match(said, rest.moved) if said else rest.moved == ""
    assert len(rest.state) == len(state)
    assert not rest.state[-6:].any()


def test_what_slides_down_a_slope_is_told(tmp_path):
    _, rest = settled(scene(tmp_path, CUBE.format(""), SLOPE), 0.15)
    assert re.match("it (drops|slides)", rest.moved)


def test_what_is_set_in_motion_may_move(tmp_path):
    cube = scene(tmp_path, CUBE.format(""))
    state, rest = settled(cube, 0.5, velocity=1.0)
    assert rest.moved == ""
    assert World(cube, Start.of(cube).model).moves(state, "it")
