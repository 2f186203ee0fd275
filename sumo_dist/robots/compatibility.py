"""Whether a policy's contract fits the robot and the model that it is about to drive."""

from collections.abc import Iterable, Iterator
from itertools import zip_longest

import mujoco
import numpy as np

from sumo_dist.errors import SumoError
from sumo_dist.policies import hold
from sumo_dist.policies.contract import PolicyContract
from sumo_dist.robots.robot import Robot
from sumo_dist.timing import TICK


def check(contract: PolicyContract, robot: Robot, model: mujoco.MjModel) -> None:
    """Compare a policy's contract with a robot and its compiled model.

    The robot comes first in the model: its free joint, its joints, its actuators. Joint targets
    (`policies.hold`) are not what the robot's own policy takes, but every robot follows them.

    Raises:
        SumoError: they differ; the message names every difference.
    """
    joints = list(_joints(contract, model))
    # gains mean nothing while the joints differ
    gains = [] if joints else _gains(contract, model)
    differences = [*_robot(contract, robot), *joints, *gains, *_rate(contract, model)]
    if differences:
        listed = "".join(f"\n    {line}" for line in differences)
        raise SumoError(f"policy {contract.name!r} does not fit robot {robot.name!r}:{listed}")


def _robot(contract: PolicyContract, robot: Robot) -> Iterator[str]:
    if contract.name != hold.NAME:
        yield from _policy(contract, robot)
    yield from _order("robot's joints", robot.joints, contract.joints)


def _policy(contract: PolicyContract, robot: Robot) -> Iterator[str]:
    if robot.policy != contract.name:
        yield f"policy: the robot names {robot.policy!r}"
    if len(robot.default_command) != contract.command_size:
        yield (
            f"command: the robot's default has {len(robot.default_command)} numbers, "
            f"the policy takes {contract.command_size}"
        )


def _joints(contract: PolicyContract, model: mujoco.MjModel) -> Iterator[str]:
    count = len(contract.joints)
    if model.njnt < 1 or model.jnt_type[0] != mujoco.mjtJoint.mjJNT_FREE:
        yield "model's joints: the first is not the robot's free joint"
    names = (model.joint(index).name for index in range(1, min(model.njnt, count + 1)))
    yield from _order("model's joints", names, contract.joints)
    if model.nu != count:
        yield f"model's actuators: {model.nu}, the policy drives {count}"
    driven = (model.joint(joint).name for joint in model.actuator_trnid[:count, 0])
    yield from _order("model's actuators", driven, contract.joints)


def _order(what: str, found: Iterable[str], expected: tuple[str, ...]) -> Iterator[str]:
    pairs = zip_longest(found, expected, fillvalue="nothing")
    for index, (name, wanted) in enumerate(pairs):
        if name != wanted:
            yield f"{what}: {name} at {index}, the policy wants {wanted}"


def _gains(contract: PolicyContract, model: mujoco.MjModel) -> Iterator[str]:
    """A position servo's force is kp * target - kp * q - kd * qd."""
    for index, (joint, kp, kd) in enumerate(
        zip(contract.joints, contract.kp, contract.kd, strict=True)
    ):
        found = (model.actuator_gainprm[index, 0], *model.actuator_biasprm[index, :3])
        if not np.allclose(found, (kp, 0.0, -kp, -kd), rtol=1e-9, atol=1e-12):
            servo = f"kp {found[0]:g}, bias {found[1]:g} {found[2]:+g} q {found[3]:+g} qd"
            yield f"gains of {joint}: {servo}; the policy wants kp {kp:g}, kd {kd:g}"


def _rate(contract: PolicyContract, model: mujoco.MjModel) -> Iterator[str]:
    if not np.isclose(contract.rate_hz * TICK, 1.0):
        yield f"rate: a tick is {TICK:g} s, the policy wants {1.0 / contract.rate_hz:g} s"
    substeps = TICK / model.opt.timestep
    if substeps < 0.5 or not np.isclose(substeps, round(substeps)):
        yield f"time step: {model.opt.timestep:g} s does not divide a tick of {TICK:g} s"
