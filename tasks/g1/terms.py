"""What the G1 tasks share: cost terms of the paper's appendix, and where a trial starts."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.costs.view import View
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import Scene, SceneObject
from sumo_dist.robots.g1 import G1
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.tasks.reset import Start, redraw

FLOOR_FRICTION = 1.0
WORKSPACE = 6.0  # what is farther from the origin cannot be fetched within an episode [m]

FALL_WEIGHT = 2500.0
CONTROL_WEIGHT = 3.0

# The paper's trials start alike. Ours differ by these, drawn uniformly, so that a rate over seeds
# says more than one trial repeated.
POSITION_NOISE = 0.05  # of robot and object on both axes [m]
YAW_NOISE = 0.1  # of robot and object [rad]

ROBOT_FRAMES = {
    "base": FrameRef("body", G1.base),
    "left_palm": FrameRef("site", "left_palm"),
    "right_palm": FrameRef("site", "right_palm"),
}


def scene(objects: tuple[SceneObject, ...] = (), fixtures: tuple[SceneObject, ...] = ()) -> Scene:
    """Return G1 on a floor whose friction yields to that of whatever stands on it."""
    return Scene(G1, objects, fixtures, floor_friction=FLOOR_FRICTION, floor_priority=0)


def fallen(r: View) -> np.ndarray:
    """Whether the pelvis is no higher than where the robot counts as fallen, (B, T)."""
    return r.base.pos[..., 2] <= G1.fall_height


def heading(r: View) -> np.ndarray:
    """How far the robot faces along world x, (B, T), 1 for straight on."""
    return r.base.x[..., 0]


def regularisation(actions: ActionSpace) -> CostTerm:
    """Build the term 3 (||v_base|| + ||q_arm - q_def||) of an action space."""
    default = actions.default

    def effort(r: View) -> np.ndarray:
        speed = norm(r.actions[..., :3])
        if len(default) == 3:
            return speed
        return speed + norm(r.actions[..., 3:] - default[3:])

    return CostTerm("control", effort, CONTROL_WEIGHT)


FALL = CostTerm("fall", fallen, FALL_WEIGHT, "any")


@dataclass(frozen=True)
class NearReset:
    """Robot and object stand at their places, give or take the noise above, and do not touch.

    Attributes:
        robot: where the robot stands, xy [m], facing along x.
        objects: by name, where each stands, its position [m].
    """

    robot: tuple[float, float]
    objects: dict[str, tuple[float, float, float]]

    def __call__(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        """Draw until nothing touches the robot."""
        return redraw(
            lambda: self._draw(rng, start),
            lambda state: not any(start.touching(state, name) for name in self.objects),
        )

    def _draw(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        def off(xy: np.ndarray) -> tuple[np.ndarray, float]:
            yaw = float(rng.uniform(-YAW_NOISE, YAW_NOISE))
            return xy + rng.uniform(-POSITION_NOISE, POSITION_NOISE, 2), yaw

        robot_xy, robot_yaw = off(np.array(self.robot))
        objects = {}
        for name, place in self.objects.items():
            xy, yaw = off(np.array(place[:2]))
            quat = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
            objects[name] = np.array([*xy, place[2]]), quat
        return start.place(robot_xy, robot_yaw, objects)
