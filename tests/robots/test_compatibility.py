from dataclasses import replace

import mujoco
import pytest

from sumo_dist.errors import SumoError
from sumo_dist.model.scene import PLANNING, PLANT, Scene, compile_model
from sumo_dist.policies import load_policy
from sumo_dist.policies.contract import PolicyContract
from sumo_dist.robots.compatibility import check
from sumo_dist.robots.robot import Robot
from sumo_dist.robots.spot import SPOT

JOINTS = ("hip", "knee", "hand")
CONTRACT = PolicyContract(
    name="toy",
    rate_hz=50.0,
    joints=JOINTS,
    kp=(60.0, 60.0, 16.0),
    kd=(1.5, 1.5, 0.32),
    command_size=3,
    observation_size=20,
    action_size=2,
    memory_size=2,
    weights_sha256="0" * 64,
)
ROBOT = Robot(
    name="toy",
    mjcf="robots/toy.xml",
    base="base",
    joints=JOINTS,
    stand=(0.0, 0.0, 0.0),
    stand_height=0.5,
    sit=(0.0, 0.0, 0.0),
    fall_height=0.2,
    policy="toy",
    default_command=(0.0, 0.0, 0.0),
)


def compile_toy(joints=JOINTS, driven=JOINTS, gains=((60, 1.5), (60, 1.5), (16, 0.32)), dt=0.01):
    """A free base with three hinges, and a free object behind it."""
    links = "".join(
        f'<body><joint name="{joint}"/><geom size=".1" mass="1"/></body>' for joint in joints
    )
    servos = "".join(
        f'<position joint="{joint}" kp="{kp}" kv="{kv}"/>'
        for joint, (kp, kv) in zip(driven, gains, strict=False)
    )
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{dt}"/><worldbody>
        <body name="base"><freejoint name="root"/><geom size=".1" mass="1"/>{links}</body>
        <body name="box"><freejoint name="box"/><geom size=".1" mass="1"/></body>
        </worldbody><actuator>{servos}</actuator></mujoco>"""
    )


@pytest.mark.parametrize("options", [PLANT, PLANNING])
def test_spot_fits_its_policy(options):
    check(load_policy("spot").contract, SPOT, compile_model(Scene(SPOT), options))


def test_a_robot_that_fits():
    check(CONTRACT, ROBOT, compile_toy())


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"joints": ("knee", "hip", "hand")}, "model's joints: knee at 0, the policy wants hip"),
        ({"driven": ("hip", "hand", "knee")}, "actuators: hand at 1, the policy wants knee"),
        ({"driven": ("hip", "knee")}, "model's actuators: 2, the policy drives 3"),
        ({"gains": ((60, 1.5), (75, 1.5), (16, 0.32))}, "gains of knee: kp 75, .* wants kp 60"),
        ({"gains": ((60, 1.5), (60, 1.5), (16, 0.5))}, "gains of hand: .*-0.5 qd; .* kd 0.32"),
        ({"dt": 0.007}, "time step: 0.007 s does not divide a tick of 0.02 s"),
    ],
)
def test_a_model_that_differs(changes, complaint):
    with pytest.raises(SumoError, match=complaint):
        check(CONTRACT, ROBOT, compile_toy(**changes))


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"policy": "other"}, "policy: the robot names 'other'"),
        ({"joints": ("hip", "knee")}, "robot's joints: nothing at 2, the policy wants hand"),
        ({"default_command": (0.0,)}, "default has 1 numbers, the policy takes 3"),
    ],
)
def test_a_robot_that_differs(changes, complaint):
    with pytest.raises(SumoError, match=complaint):
        check(CONTRACT, replace(ROBOT, **changes), compile_toy())


def test_a_policy_of_another_rate():
    with pytest.raises(SumoError, match=r"rate: a tick is 0\.02 s, the policy wants 0\.01 s"):
        check(replace(CONTRACT, rate_hz=100.0), ROBOT, compile_toy())


def test_every_difference_is_named_at_once():
    model = compile_toy(gains=((1, 1.5), (60, 9), (16, 0.32)), dt=0.03)
    with pytest.raises(SumoError) as caught:
        check(CONTRACT, replace(ROBOT, policy="other"), model)
    message = str(caught.value)
    assert message.startswith("policy 'toy' does not fit robot 'toy':\n")
    assert len(message.splitlines()) == 5
