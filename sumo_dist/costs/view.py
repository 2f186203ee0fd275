"""Named arrays for cost functions: `r.object.pos` instead of index arithmetic."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from sumo_dist.costs.parameters import NO_PARAMETERS, Parameters
from sumo_dist.errors import UsageError, unknown
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.index import StateIndex


@dataclass(frozen=True)
class Frame:
    """One named frame over B rollouts and T steps, in the world frame.

    Attributes:
        name: the frame's name in the task.
        pos: (B, T, 3) origin [m].
        rot: (B, T, 3, 3) axes as columns.
        velocity: (B, T, 6) linear velocity of the origin, world [m/s], and angular velocity, body
            [rad/s]; None for a frame that is not a free body.
    """

    name: str
    pos: np.ndarray
    rot: np.ndarray
    velocity: np.ndarray | None = None

    @property
    def x(self) -> np.ndarray:
        """(B, T, 3) the frame's x axis, world."""
        return self.rot[..., 0]

    @property
    def y(self) -> np.ndarray:
        """(B, T, 3) the frame's y axis, world."""
        return self.rot[..., 1]

    @property
    def z(self) -> np.ndarray:
        """(B, T, 3) the frame's z axis, world."""
        return self.rot[..., 2]

    @property
    def linvel(self) -> np.ndarray:
        """(B, T, 3) linear velocity of the origin, world [m/s]."""
        return self._twist()[..., :3]

    @property
    def angvel(self) -> np.ndarray:
        """(B, T, 3) angular velocity, body frame [rad/s]."""
        return self._twist()[..., 3:]

    def _twist(self) -> np.ndarray:
        if self.velocity is None:
            raise UsageError(
                f"frame {self.name!r} has no velocity: it is not a body with a free joint"
            )
        return self.velocity


@dataclass(frozen=True)
class Joint:
    """One hinge or slide over B rollouts and T steps.

    Attributes:
        pos: (B, T) [rad] or [m].
        vel: (B, T) [rad/s] or [m/s].
        servo: (B, T) position that its servo held during the step; None for a joint without one.
    """

    pos: np.ndarray
    vel: np.ndarray
    servo: np.ndarray | None = None

    @property
    def target(self) -> np.ndarray:
        """(B, T) position that its servo held during the step [rad] or [m]."""
        if self.servo is None:
            raise UsageError("this joint has no target: no servo drives it")
        return self.servo


class Joints(Mapping[str, Joint]):
    """The joints of all bodies of a scene, by the names of its model."""

    def __init__(
        self,
        states: np.ndarray,
        targets: np.ndarray,
        columns: Mapping[str, tuple[int, int]],
        servos: Mapping[str, int],
    ) -> None:
        """Hold states (B, T, nq + nv) and targets (B, T, nu), and where in them each joint is."""
        self._states, self._targets = states, targets
        self._columns, self._servos = columns, servos

    def __getitem__(self, name: str) -> Joint:
        """Return a joint, or say which there are."""
        if name not in self._columns:
            raise unknown("joint", name, self._columns)
        pos, vel = self._columns[name]
        servo = self._targets[..., self._servos[name]] if name in self._servos else None
        return Joint(self._states[..., pos], self._states[..., vel], servo)

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)


NO_JOINTS: Mapping[str, Joint] = {}
NO_STATES = np.empty((0, 0, 0))


class View:
    """What residuals and success tests see.

    Frames are attributes (`r.gripper`, `r.object`) or looked up (`r["object"]`).

    Attributes:
        actions: (B, T, nu) physical actions.
        p: the task's parameters (`r.p.goal`).
        joints: hinges and slides by name (`r.joints["door/hinge"].pos`).
        states: (B, T, nq + nv) of the model that is planned with, for what needs all of it.
    """

    def __init__(
        self,
        frames: Mapping[str, Frame],
        actions: np.ndarray,
        parameters: Parameters = NO_PARAMETERS,
        joints: Mapping[str, Joint] = NO_JOINTS,
        states: np.ndarray = NO_STATES,
    ) -> None:
        """Hold frames by name, actions, parameters, joints and states."""
        self._frames = frames
        self.actions = actions
        self.p = parameters
        self.joints = joints
        self.states = states

    def __getitem__(self, name: str) -> Frame:
        """Return the frame of that name, or say which names there are."""
        return getattr(self, name)

    def __getattr__(self, name: str) -> Frame:
        """Return the frame of that name, or say which names there are."""
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in self._frames:
            raise unknown("frame", name, self._frames)
        return self._frames[name]


class ViewLayout:
    """Where the named frames of a task lie in an engine's output."""

    def __init__(self, model: mujoco.MjModel, frames: Mapping[str, FrameRef]) -> None:
        """Resolve frame names against a compiled model."""
        self.names = tuple(frames)
        self.refs = tuple(frames.values())
        index = StateIndex(model)
        self._joints = index.columns
        driven = (model.joint(joint).name for joint in model.actuator_trnid[:, 0])
        self._servos = {name: servo for servo, name in enumerate(driven)}
        self._velocity = {
            name: index.velocity(ref.name)
            for name, ref in frames.items()
            if ref.kind == "body" and ref.name in index.free_bodies
        }

    def view(
        self,
        states: np.ndarray,
        targets: np.ndarray,
        positions: np.ndarray,
        rotations: np.ndarray,
        actions: np.ndarray,
        parameters: Parameters = NO_PARAMETERS,
    ) -> View:
        """Name the arrays of B rollouts: see rollout.interface.Rollouts for the shapes."""
        frames = {}
        for i, name in enumerate(self.names):
            velocity = states[..., self._velocity[name]] if name in self._velocity else None
            frames[name] = Frame(name, positions[:, :, i], rotations[:, :, i], velocity)
        joints = Joints(states, targets, self._joints, self._servos)
        return View(frames, actions, parameters, joints, states)

    def at(self, data: mujoco.MjData, nu: int = 0, parameters: Parameters = NO_PARAMETERS) -> View:
        """Name the arrays of a simulation's present: one rollout of one step, all nu actions 0.

        The simulation's kinematics must be up to date.
        """
        frames = [
            data.site(ref.name) if ref.kind == "site" else data.body(ref.name) for ref in self.refs
        ]
        return self.view(
            np.concatenate([data.qpos, data.qvel])[None, None],
            data.ctrl[None, None].copy(),
            np.array([frame.xpos for frame in frames])[None, None],
            np.array([frame.xmat for frame in frames]).reshape(1, 1, -1, 3, 3),
            np.zeros((1, 1, nu)),
            parameters,
        )
