"""Spot's model against the numbers of the robot that the policy was trained on."""

import mujoco
import numpy as np
import pytest

from sumo_dist.model.files import ASSETS
from sumo_dist.model.scene import PLANT, Scene, compile_model
from sumo_dist.robots.spot import ARM_STOWED, SPOT, STANDING

# body: mass [kg], centre of mass [m], inertia xx yy zz xy xz yz [kg m^2], in the body's frame.
# The other legs are mirror images of the front left one.
INERTIAS = {
    "body": (
        16.70765207,
        (0.0, 0.0, -0.00496172),
        (0.081543792, 0.549231154, 0.569454373, 0.0, 0.0, 0.0),
    ),
    "front_left_hip": (
        1.13688339,
        (-0.01586739, 0.00855842, 0.00000903),
        (0.00122166, 0.00158957, 0.00172903, -0.00017754, 0.00000043, -0.00000049),
    ),
    "front_left_upper_leg": (
        2.25620359,
        (0.00214442, -0.01110184, -0.07881204),
        (0.02692501, 0.02583907, 0.00318737, -0.00008782, 0.00054873, 0.00207146),
    ),
    "front_left_lower_leg": (
        0.33,
        (0.0059736, 0.0, -0.17466427),
        (0.00701356, 0.00709946, 0.00014529, 0.0, 0.000066, 0.0),
    ),
    "arm_link_sh0": (
        1.904699,
        (-0.008399, 0.000272, -0.024603),
        (0.008896, 0.004922, 0.007303, 0.000005, -0.000193, 0.000033),
    ),
    "arm_link_sh1": (
        1.85701942,
        (0.08084909, -0.00167243, 0.00045644),
        (0.00261526, 0.02703868, 0.02819929, -0.00040406, 0.00010019, 0.00000547),
    ),
    "arm_link_el0": (
        0.94831958,
        (0.04476621, -0.0027113, 0.04991363),
        (0.00175909, 0.00269233, 0.00202854, 0.00006087, 0.0009238, 0.00005217),
    ),
    "arm_link_el1": (
        1.0175482,
        (-0.16867073, -0.01616121, 0.00001149),
        (0.0011771, 0.01649389, 0.01689901, -0.00260549, 0.00000156, -0.00000287),
    ),
    "arm_link_wr0": (
        0.5826374,
        (0.00952465, -0.01144406, 0.00000186),
        (0.00046738, 0.00044968, 0.00053616, 0.00006957, 0.0000004, 0.00000016),
    ),
    "arm_link_wr1": (
        0.93335298,
        (0.09751283, 0.00009265, -0.01120523),
        (0.00098836, 0.00197018, 0.00165791, -0.00000126, -0.00036919, -0.00000074),
    ),
    "arm_link_fngr": (
        0.22383315,
        (0.03565178, 0.000672, -0.01227516),
        (0.00025226, 0.00048453, 0.00059145, -0.00000536, -0.00015067, 0.00000184),
    ),
}

# joint: axis, range [rad], armature, kp, kv, torque limit [Nm]
JOINTS = {
    "hx": ("x", (-0.785398, 0.785398), 0.0403155, 60.0, 1.5, 45.0),
    "hy": ("y", (-0.898845, 2.295108), 0.0403155, 60.0, 1.5, 45.0),
    "kn": ("y", (-2.7929, -0.2471), 0.073125, 60.0, 1.5, 115.0),
    "sh0": ("z", (-2.617993878, 3.141592654), 0.1795376, 120.0, 2.0, 90.9),
    "sh1": ("y", (-3.141592654, 0.523598776), 0.7181504, 120.0, 2.0, 181.8),
    "el0": ("y", (0.0, 3.141592654), 0.1795376, 120.0, 2.0, 90.9),
    "el1": ("x", (-2.792526803, 2.792526803), 0.05477937, 120.0, 2.0, 30.3),
    "wr0": ("y", (-1.832595715, 1.832595715), 0.05477937, 120.0, 2.0, 30.3),
    "wr1": ("x", (-2.879793266, 2.879793266), 0.07997584, 120.0, 2.0, 30.3),
    "f1x": ("y", (-1.57, 0.0), 0.01717273, 16.0, 0.32, 15.32),
}

EXCLUDED = {
    ("arm_link_sh0", "arm_link_el1"),
    ("arm_link_sh1", "arm_link_el0"),
    ("arm_link_sh1", "arm_link_el1"),
    *(
        (body, f"{leg}_upper_leg")
        for body in ("body", "arm_link_sh0")
        for leg in ("front_left", "front_right", "rear_left", "rear_right")
    ),
}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return compile_model(Scene(SPOT), PLANT)


def full_inertia(model: mujoco.MjModel, body: str) -> np.ndarray:
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.body(body).iquat)
    axes = rotation.reshape(3, 3)
    inertia = axes @ np.diag(model.body(body).inertia) @ axes.T
    return inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def test_total_mass(model):
    assert model.body_mass.sum() == pytest.approx(39.06740972, abs=1e-8)


@pytest.mark.parametrize("body", INERTIAS)
def test_mass_and_inertia(model, body):
    mass, com, inertia = INERTIAS[body]
    assert model.body(body).mass == mass
    np.testing.assert_array_equal(model.body(body).ipos, com)
    np.testing.assert_allclose(full_inertia(model, body), inertia, atol=1e-11)


@pytest.mark.parametrize("part", ["hip", "upper_leg", "lower_leg"])
def test_legs_are_mirror_images(model, part):
    mass, com, inertia = INERTIAS[f"front_left_{part}"]
    for end, x in (("front", 1), ("rear", -1)):
        for side, y in (("left", 1), ("right", -1)):
            body = model.body(f"{end}_{side}_{part}")
            x_of_part = x if part == "hip" else 1  # upper and lower legs all bend backwards
            signs = np.array([1, 1, 1, x_of_part * y, x_of_part, y])
            assert body.mass == mass
            np.testing.assert_array_equal(body.ipos, np.array([x_of_part, y, 1]) * com)
            np.testing.assert_allclose(full_inertia(model, body.name), signs * inertia, atol=1e-11)


def test_joints_follow_the_robots_order(model):
    names = [model.joint(i).name for i in range(model.njnt)]
    assert names == ["base", *SPOT.joints]
    assert [model.joint(i).name for i in model.actuator_trnid[:, 0]] == list(SPOT.joints)
    assert (model.nq, model.nv, model.nu) == (26, 25, 19)


@pytest.mark.parametrize("name", SPOT.joints)
def test_joint_and_servo(model, name):
    axis, limits, armature, kp, kv, torque = JOINTS[name.split("_")[1]]
    joint, servo = model.joint(name), model.actuator(name)
    dof = joint.dofadr[0]
    np.testing.assert_array_equal(joint.axis, np.eye(3)["xyz".index(axis)])
    np.testing.assert_array_equal(joint.range, limits)
    assert joint.limited and servo.ctrllimited and servo.forcelimited
    assert model.dof_armature[dof] == armature
    assert (model.dof_damping[dof], model.dof_frictionloss[dof]) == (0.25, 0.5)
    np.testing.assert_array_equal(servo.gainprm[:3], [kp, 0, 0])
    np.testing.assert_array_equal(servo.biasprm[:3], [0, -kp, -kv])
    np.testing.assert_array_equal(servo.forcerange, [-torque, torque])
    np.testing.assert_allclose(servo.ctrlrange, limits, atol=3e-6)


def test_collision_geoms(model):
    solid = [model.geom(i) for i in np.flatnonzero(model.geom_contype)]
    robot = [geom for geom in solid if geom.bodyid != 0]
    assert len(robot) == 27
    for geom in robot:
        np.testing.assert_array_equal(geom.friction, [0.15, 0.005, 0.0001])
        assert (geom.priority, geom.conaffinity, geom.condim, geom.group) == (4, 1, 3, 3)
    foot = model.geom("rear_left_foot_collision")
    assert foot.size[0] == 0.036
    np.testing.assert_array_equal(foot.pos, model.site("site_rear_left").pos)


def test_excluded_pairs(model):
    pairs = {divmod(int(signature), 1 << 16) for signature in model.exclude_signature}
    names = {frozenset(model.body(i).name for i in pair) for pair in pairs}
    assert names == {frozenset(pair) for pair in EXCLUDED}


def test_what_is_only_seen_has_no_mass_and_touches_nothing(model):
    seen = model.geom_group == 2
    assert 30 < seen.sum() <= 60
    assert not (model.geom_contype[seen] | model.geom_conaffinity[seen]).any()


MODELS = sorted(path for path in ASSETS.rglob("*.xml") if path.parent.name != "parts")


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.name)
def test_models_are_made_of_primitives(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.nmesh == 0
    assert model.nhfield == 0


@pytest.mark.parametrize(
    ("arm", "sites", "com"),
    [
        (
            SPOT.stand[12:],
            {
                "site_front_left": (0.3297, 0.2260, 0.0287),
                "site_front_right": (0.3297, -0.2260, 0.0287),
                "site_rear_left": (-0.2660, 0.2260, 0.0287),
                "site_rear_right": (-0.2660, -0.2260, 0.0287),
                "site_arm_link_fngr": (0.9293, 0.0, 0.7187),
                "site_arm_link_wr1": (0.8119, 0.0, 0.7039),
            },
            (0.0878, -0.0007, 0.5414),
        ),
        (
            (*ARM_STOWED, 0.0),
            {
                "site_arm_link_fngr": (0.4761, 0.0, 0.7981),
                "site_arm_link_wr1": (0.3584, 0.0, 0.7856),
            },
            (0.0340, -0.0001, 0.5354),
        ),
    ],
    ids=["unstowed", "stowed"],
)
def test_forward_kinematics(model, arm, sites, com):
    data = mujoco.MjData(model)
    data.qpos[:] = [0, 0, 0.52, 1, 0, 0, 0, *STANDING, *arm]
    mujoco.mj_forward(model, data)
    for site, position in sites.items():
        np.testing.assert_allclose(data.site(site).xpos, position, atol=6e-5, err_msg=site)
    np.testing.assert_allclose(data.subtree_com[0], com, atol=6e-5)
    body = model.site("site_body")
    np.testing.assert_array_equal(body.pos, [0.0, 0.0, 0.1])
