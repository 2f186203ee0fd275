import mujoco
import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.model.scene import PLANT, Scene, SceneObject, compile_model
from sumo_dist.model.settle import (
    height_above_floor,
    settled_stand,
    why_it_falls,
    without_robot,
)
from sumo_dist.robots.spot import SPOT


def test_the_stand_touches_the_floor_with_all_feet_and_nothing_else():
    model = compile_model(Scene(SPOT), PLANT)
    qpos = settled_stand(SPOT)
    np.testing.assert_array_equal(qpos[[0, 1, 3, 4, 5, 6]], [0, 0, 1, 0, 0, 0])
    np.testing.assert_array_equal(qpos[7:], SPOT.stand)
    assert qpos[2] == pytest.approx(0.52725, abs=1e-5)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    data.qpos[2] -= 1e-6
    mujoco.mj_forward(model, data)
    feet = {model.geom(max(contact.geom)).name for contact in data.contact}
    assert feet == {
        f"{end}_{side}_foot_collision" for end in ("front", "rear") for side in ("left", "right")
    }


def test_the_stand_is_not_thrown_up():
    model = compile_model(Scene(SPOT), PLANT)
    heights = []
    for lift in (0.0, SPOT.stand_height - settled_stand(SPOT)[2]):
        data = mujoco.MjData(model)
        data.qpos[:] = settled_stand(SPOT)
        data.qpos[2] += lift
        data.ctrl[:] = SPOT.stand
        mujoco.mj_step(model, data)
        heights.append(data.qvel[2])
    settled, nominal = heights
    assert -0.1 < settled < 0.0  # less than free fall over one step
    assert nominal > settled  # the floor pushes the nominal stance up


@pytest.mark.parametrize("seed", range(5))
def test_height_of_a_turned_box_is_that_of_its_lowest_corner(seed):
    model = compile_model(Scene(SPOT, (SceneObject("box", "objects/box.xml"),)), PLANT)
    rng = np.random.default_rng(seed)
    quat, height = rng.normal(size=4), rng.uniform(-0.5, 2.0)
    quat /= np.linalg.norm(quat)
    qpos = model.qpos0.copy()
    qpos[26:33] = [3.0, 0.0, height, *quat]
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, quat)
    lowest = height - 0.254 * np.abs(rotation[6:]).sum()
    assert height_above_floor(model, qpos, "box") == pytest.approx(lowest, abs=1e-9)


@pytest.mark.parametrize(
    ("inside", "reason"),
    [
        ('<geom size=".1" contype="0" conaffinity="0"/>', "none of its geoms touches the floor"),
        ('<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>', "it has no geom"),
    ],
)
def test_what_cannot_touch_has_no_height_above_the_floor(tmp_path, inside, reason):
    mjcf = f'<mujoco><worldbody><body name="it">{inside}</body></worldbody></mujoco>'
    (tmp_path / "it.xml").write_text(mjcf)
    model = compile_model(Scene(SPOT, (SceneObject("it", str(tmp_path / "it.xml")),)), PLANT)
    assert why_it_falls(model, "it").startswith(reason)
    with pytest.raises(UsageError, match=f"'it' cannot lie on the floor: {reason}"):
        height_above_floor(model, model.qpos0, "it")


def test_a_scene_without_its_robot_is_the_rest_of_it():
    scene = Scene(SPOT, (SceneObject("box", "objects/box.xml"),))
    alone, whole = without_robot(scene), compile_model(scene, PLANT)
    assert (alone.nq, alone.nv, alone.nu) == (7, 6, 0)
    assert alone.body("box").mass == whole.body("box").mass
    assert whole.nq - alone.nq == 7 + len(SPOT.joints)
