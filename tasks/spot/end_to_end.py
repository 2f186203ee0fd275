"""Spot moves objects without a policy: the planner searches the joints' targets (paper, baseline).

The paper plans for 19 joints at 50 Hz with the cost of a gait added to that of the move, and names
MuJoCo MPC for the former. Its terms are those of that project's task Quadruped Flat in a trot, for
a robot twice as long in the leg: docs/decisions/0026.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.costs.view import View
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import SceneObject
from sumo_dist.policies.spot_layout import KD, KP, LEG_JOINTS
from sumo_dist.robots.joint_actions import joint_actions
from sumo_dist.robots.spot import SPOT, STANDING
from sumo_dist.tasks.reset import Start
from sumo_dist.tasks.spot.analysis import ANALYSIS
from sumo_dist.tasks.task import Task

CADENCE = 2.0  # steps of a foot per second [Hz]
DUTY = 0.45  # share of a step for which a foot stands
SWING = {"front_left": 0.0, "rear_left": 0.5, "front_right": 0.5, "rear_right": 0.0}  # of a step
FOOT_RADIUS = 0.036  # [m]
MASS_AHEAD = 0.088  # of the torso's origin, in the stance: the centre of all mass [m]
GRAVITY = 9.81  # [m/s^2]
SPREAD = (2.0, 1.0, 1.0) * 4  # how much a leg's joints count in the posture: hx, hy, kn
PHASE = "metronome/phase"  # joint that turns once a step
REACH = 0.8  # of a joint's target [rad]

# Targets at which the servos bear the stance: its joints plus torque over stiffness.
BEARING = (
    *(-0.157, 0.806, -1.033, 0.158, 0.806, -1.033),
    *(-0.056, 0.785, -1.164, 0.056, 0.785, -1.164),
    *(0.0, -1.048, 1.723, 0.0, -0.911, 0.0, 0.0),
)


def smooth_abs(x: np.ndarray, width: float) -> np.ndarray:
    """|x|, rounded within a width of 0."""
    return np.sqrt(x * x + width * width) - width


def legs(r: View) -> np.ndarray:
    """Joints of the legs, (B, T, 12) [rad]."""
    return np.stack([r.joints[name].pos for name in LEG_JOINTS], axis=-1)


def torques(r: View) -> np.ndarray:
    """What is asked of the legs' servos at the end of each step, (B, T, 12) [N m]."""
    joints = [r.joints[name] for name in LEG_JOINTS]
    servos = zip(joints, KP, KD, strict=False)  # the arm's come after those of the legs
    return np.stack(
        [kp * (joint.target - joint.pos) - kd * joint.vel for joint, kp, kd in servos], axis=-1
    )


def stance(r: View) -> np.ndarray:
    """Middle of the feet, (B, T, 3) world [m]."""
    front_left, rear_left, front_right, rear_right = (r[foot].pos for foot in SWING)
    return (front_left + rear_left + front_right + rear_right) / 4


def lift(phase: np.ndarray, swing: float) -> np.ndarray:
    """How high a foot should be, from 0 on the ground to 1.

    Args:
        phase: of the gait [rad].
        swing: where in a step the foot is highest, from 0 to 1.
    """
    angle = np.mod(phase + np.pi - 2.0 * np.pi * swing, 2.0 * np.pi) - np.pi
    return np.cos(np.clip(angle * 0.5 / (1.0 - DUTY), -np.pi / 2, np.pi / 2))


def upright(r: View) -> np.ndarray:
    """How far the torso's up axis is from the vertical, (B, T)."""
    return smooth_abs(r.base.z[..., 2] - 1.0, 0.05)


def height(r: View) -> np.ndarray:
    """How far the torso is from its height above the feet, (B, T) [m]."""
    return smooth_abs(r.base.pos[..., 2] - stance(r)[..., 2] - r.p.torso_height, 0.04)


def gait(r: View) -> np.ndarray:
    """How far the feet that swing are from their heights, (B, T) [m]."""
    off = np.zeros(r.base.pos.shape[:2])
    for foot, swing in SWING.items():
        up = lift(r.joints[PHASE].pos, swing)
        away = r[foot].pos[..., 2] - FOOT_RADIUS - r.p.step_height * up
        off = off + np.where(up > 1e-6, smooth_abs(away, 0.03), 0.0)
    return off


def balance(r: View) -> np.ndarray:
    """How far the capture point is from the middle of the feet, (B, T) [m]."""
    falls = np.sqrt(2.0 * r.p.torso_height / GRAVITY)
    mass = r.base.pos + MASS_AHEAD * r.base.x
    capture = mass + falls * r.base.linvel
    return smooth_abs(norm((capture - stance(r))[..., :2]), 0.1)


def effort(r: View) -> np.ndarray:
    """Half the squared norm of the legs' torques over 100 N m, (B, T)."""
    return 0.5 * norm(torques(r) / 100.0) ** 2


def posture(r: View) -> np.ndarray:
    """Half the squared distance of the legs' joints from the stance, (B, T) [rad^2]."""
    return 0.5 * norm(np.array(SPREAD) * (legs(r) - np.array(STANDING))) ** 2


# Weights of that project times 60, those of gait and balance less: docs/decisions/0026.
LOCOMOTION = (
    CostTerm("upright", upright, 60.0),
    CostTerm("height", height, 60.0),
    CostTerm("gait", gait, 30.0),
    CostTerm("balance", balance, 4.0),
    CostTerm("effort", effort, 1.8),
    CostTerm("posture", posture, 1.2),
)
SEARCH = {
    "optimizer": "cem",
    "rate": 50,
    "horizon": 0.5,
    "rollouts": 32,
    "nodes": 6,
    "variance_last": 0.2,
}


@dataclass(frozen=True)
class InStep:
    """A reset whose metronome turns.

    Attributes:
        reset: of all else.
    """

    reset: Callable[[np.random.Generator, Start], np.ndarray]

    def __call__(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        """Draw a state."""
        state = self.reset(rng, start)
        state[start.index.columns[PHASE][1]] = 2.0 * np.pi * CADENCE
        return state


def joints_move(name: str) -> Task:
    """Spot moves an object by the targets of its joints, without a low-level policy.

    Cost (paper): J_locomotion + J_move, the former that of a trot of MuJoCo MPC. Of its terms the
    position's is left out: what the robot should come to, the move says. The gripper stays closed.

    Args:
        name: of the object.
    """
    task = ANALYSIS[f"spot/move_{name}"]()
    return replace(
        task,
        name=f"spot/joints_move_{name}",
        scene=replace(task.scene, fixtures=(SceneObject("metronome", "fixtures/metronome.xml"),)),
        actions=joint_actions(SPOT, SPOT.joints[:-1], REACH, BEARING),
        frames={**task.frames, **{foot: FrameRef("site", f"site_{foot}") for foot in SWING}},
        cost=(*task.cost, *LOCOMOTION),
        parameters=(
            *task.parameters,
            Parameter("torso_height", 0.49, "m", (0.2, 0.7)),
            Parameter("step_height", 0.06, "m", (0.0, 0.3)),
        ),
        reset=InStep(task.reset),
        controller="joint-targets",
        planner=SEARCH,
        description=f"Spot pushes the {name} to its goal by its joints alone, without a policy",
    )


END_TO_END: dict[str, Callable[[], Task]] = {
    f"spot/joints_move_{name}": partial(joints_move, name)
    for name in ("box", "chair", "cone", "tire", "rack")
}
