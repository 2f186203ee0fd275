"""Spot's jaw closed on a bar while the rest of the robot cannot move, and pulls at the bar.

Without gravity, so that only the pull acts: an object's weight is its floor's to carry. The wrist's
axes are the world's: x out of the jaw, y along a bar in it, z from the lower jaw to the upper one.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from sumo_dist.errors import UsageError, unknown
from sumo_dist.math.rotations import matrix
from sumo_dist.model.departures import compile_without
from sumo_dist.model.scene import ModelOptions, Scene, SceneObject, build_spec
from sumo_dist.model.settle import height_above_floor, without_robot
from sumo_dist.robots.spot import GRIPPER_CLOSED, GRIPPER_OPEN, SPOT
from sumo_dist.timing import TICK

JAW, WRIST, FINGER, LOWER = "arm_f1x", "arm_link_wr1", "arm_link_fngr", "bottom_jaw_collision"
DEPTH = 0.17  # of a bar's middle in the jaw, from the wrist's axis: over the lower jaw's middle [m]
ABOVE = 0.002  # the lower jaw, the bar lies when the jaw begins to close [m]
FAR = 10.0  # the robot is above the floor, so that no object reaches it [m]
OPENINGS = np.arange(GRIPPER_OPEN, -0.5, 0.1)  # of the jaw before it closes [rad]
CLOSES_S, RISES_S, HELD_S = 1.0, 0.5, 3.0  # the jaw closes, the pull comes, the pull stays [s]
SLIPS = 0.05  # a bar that has moved this far has slipped, an object has moved [m]
TURNS = 3.0  # an object that has turned this far by then does not only slide [deg]
STEPS, MOST = (5, 1), 250  # in which a force is raised, and how far [N]
Shape = Literal["round", "square"]
OUT, ALONG = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_CAPSULE, _BOX = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_BOX
_NOTHING = 1e-6  # of a direction's length, below which it is none
_BARS = (_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER, _BOX)


@dataclass(frozen=True)
class Bar:
    """A straight bar that hangs on nothing.

    Attributes:
        shape: of its section.
        thickness: diameter or edge [m].
        friction, priority, condim: as MuJoCo's geoms have them; the robot's are 0.15, 4 and 3.
        solref: time constant of its contacts [s]; the robot's is MuJoCo's, 0.02.
        mass: [kg]; it turns slowly, as a large object does.
    """

    shape: Shape
    thickness: float
    friction: float = 1.0
    priority: int = 6
    condim: int = 3
    solref: float = 0.02
    mass: float = 10.0
    geom: str = field(default="bar", init=False)
    approach: tuple[float, float, float] = field(default=OUT, init=False)

    @property
    def name(self) -> str:
        """What a table calls it."""
        return f"{1e3 * self.thickness:g} mm {self.shape}"

    def spec(self, options: ModelOptions) -> mujoco.MjSpec:
        """Compose robot and bar, 1 m long."""
        spec, half = build_spec(Scene(SPOT), options), self.thickness / 2
        body = spec.worldbody.add_body(name="bar", mass=self.mass, inertia=[1.0] * 3)
        body.explicitinertial = True
        body.add_freejoint(name="bar_joint")
        geom = body.add_geom(name=self.geom, priority=self.priority, condim=self.condim)
        geom.friction[0], geom.contype, geom.conaffinity = self.friction, 0, 1
        geom.solref[0] = self.solref
        if self.shape == "round":
            geom.type, geom.size = _CAPSULE, [half, 0.5, 0.0]
            geom.quat = [0.5**0.5, 0.5**0.5, 0.0, 0.0]
        else:
            geom.type, geom.size = _BOX, [half, 0.5, half]
        return spec


@dataclass(frozen=True)
class Rail:
    """A bar of an object.

    Attributes:
        object: by the name that it has in a scene.
        part: the bar: the name of a capsule, a cylinder or a box in the object's file.
        approach: where the gripper points when it takes the bar, in the object's frame.
        floor_friction: of the scene in which the object is dragged.
    """

    object: SceneObject
    part: str
    approach: tuple[float, float, float] = OUT
    floor_friction: float = 0.7

    @property
    def name(self) -> str:
        """What a table calls it."""
        return self.geom

    @property
    def geom(self) -> str:
        """Name of the bar in a scene."""
        return f"{self.object.name}/{self.part}"

    @property
    def scene(self) -> Scene:
        """Robot, object and floor."""
        return Scene(SPOT, (self.object,), floor_friction=self.floor_friction)

    def spec(self, options: ModelOptions) -> mujoco.MjSpec:
        """Compose robot and object."""
        return build_spec(self.scene, options)


class Pull(NamedTuple):
    """What came of a pull: how far the bar moved, how deep it was in the jaw [m]."""

    moved: float
    deepest: float


class Grip:
    """A jaw that has closed on a bar.

    Attributes:
        stated: friction, priority, condim and solref of the bar's geom.
        mass: of what the bar belongs to [kg].
        friction: that acts between jaw and bar, 0 if they do not touch.
        angle: of the jaw, 0 closed [rad].
        torque: of its servo [N m].
        squeeze: with which the upper jaw presses [N].
    """

    def __init__(self, thing: Bar | Rail, options: ModelOptions) -> None:
        """Compile, put the bar into the open jaw and close it."""
        self._model = _hold_all_but_jaw(thing.spec(options), options)
        self._data = mujoco.MjData(self._model)
        self._geom = find_bar(self._model, thing.geom)
        self._body = int(self._model.geom_bodyid[self._geom])
        self._substeps = round(TICK / options.timestep)
        self._place(thing)
        self._open(thing)
        self._data.ctrl[:] = GRIPPER_CLOSED
        mujoco.mj_step(self._model, self._data, round(CLOSES_S / options.timestep))
        mujoco.mj_forward(self._model, self._data)
        self._closed = np.empty(mujoco.mj_stateSize(self._model, _STATE))
        mujoco.mj_getState(self._model, self._data, self._closed, _STATE)
        geom = self._model.geom(self._geom)
        whole = int(geom.priority[0]), int(geom.condim[0])
        self.stated = float(geom.friction[0]), *whole, float(geom.solref[0])
        self.mass = float(self._model.body_subtreemass[self._body])
        friction = self._data.contact.friction[self._touching(), 0]
        self.friction = float(friction.max(initial=0.0))
        self.angle = float(self._data.joint(JAW).qpos[0])
        self.torque = float(self._data.actuator(JAW).force[0])
        self.squeeze = self._squeeze()

    def pull(self, force: float, direction: tuple[float, float, float]) -> Pull:
        """Pull at the bar's middle [N], from the closed jaw anew each time."""
        model, data = self._model, self._data
        mujoco.mj_setState(model, data, self._closed, _STATE)
        mujoco.mj_forward(model, data)
        start, way = data.geom_xpos[self._geom].copy(), np.array(direction)
        moved, deepest = 0.0, self._deepest()
        for share in _rising():
            _apply(model, data, self._geom, share * force * way)
            mujoco.mj_step(model, data, self._substeps)
            moved = max(moved, float(way @ (data.geom_xpos[self._geom] - start)))
            deepest = max(deepest, self._deepest())
            if moved > SLIPS:
                break
        return Pull(moved, deepest)

    def holds(self, direction: tuple[float, float, float]) -> int:
        """Return the force up to which the bar stays in the jaw [N]."""
        return most(lambda force: self.pull(force, direction).moved <= SLIPS)

    def _place(self, thing: Bar | Rail) -> None:
        """Turn the bar across the jaw and put it just above the lower one."""
        model, data = self._model, self._data
        mujoco.mj_forward(model, data)
        pose = data.joint(int(model.body_jntadr[model.body_rootid[self._body]])).qpos
        to_object = matrix(pose[3:]).T
        local = to_object @ (data.geom_xpos[self._geom] - pose[:3])
        across = to_object @ _long_axis(model, data, self._geom)
        ahead = np.array(thing.approach) - across * (across @ np.array(thing.approach))
        if (length := np.linalg.norm(ahead)) < _NOTHING:
            raise UsageError(f"{thing.geom} lies along {thing.approach}: approach it from a side")
        turn = np.stack((ahead / length, across, np.cross(ahead / length, across)))
        mujoco.mju_mat2Quat(pose[3:], turn.ravel())
        pose[:3] = data.body(WRIST).xpos + np.array([DEPTH, 0.0, 0.1]) - turn @ local
        mujoco.mj_forward(model, data)
        lower = model.geom(LOWER).id
        pose[2] -= mujoco.mj_geomDistance(model, data, lower, self._geom, 1.0, None) - ABOVE

    def _open(self, thing: Bar | Rail) -> None:
        """Open the jaw as wide as what is around the bar lets it."""
        for angle in OPENINGS:
            self._data.joint(JAW).qpos[0] = angle
            mujoco.mj_forward(self._model, self._data)
            if not self._data.ncon:
                return
        names = {
            tuple(self._model.geom(geom).name for geom in pair) for pair in self._data.contact.geom
        }
        met = ", ".join(" and ".join(pair) for pair in sorted(names))
        raise UsageError(f"the open jaw does not fit around {thing.geom}, these overlap: {met}")

    def _touching(self) -> np.ndarray:
        """Which contacts (C,) are those of the jaw with what the bar belongs to."""
        roots = self._model.body_rootid[self._model.geom_bodyid]
        return (roots[self._data.contact.geom] == roots[self._geom]).any(axis=1)

    def _deepest(self) -> float:
        return float(-self._data.contact.dist[self._touching()].min(initial=0.0))

    def _squeeze(self) -> float:
        finger, total, force = self._model.body(FINGER).id, 0.0, np.empty(6)
        for i, geoms in enumerate(self._data.contact.geom):
            if finger in self._model.geom_bodyid[geoms]:
                mujoco.mj_contactForce(self._model, self._data, i, force)
                total += float(force[0])
        return total


class Drag(NamedTuple):
    """What it takes to move an object over the floor.

    Attributes:
        slides: the floor's friction under its weight [N].
        moves: a pull at the rail that moves it [N]; more than MOST if none does.
        how: it "slides", "turns" or "tips" then.
    """

    slides: float
    moves: int
    how: str


class Dragged:
    """An object at rest on the floor, to be pulled level and back from where a gripper stands."""

    def __init__(self, rail: Rail) -> None:
        """Put the object on the floor as its file has it, and let it come to rest."""
        self._model = without_robot(rail.scene)
        self._data = mujoco.MjData(self._model)
        self._geom = find_bar(self._model, rail.geom)
        self._pose = self._data.joint(f"{rail.object.name}_joint").qpos
        self._pose[2] -= height_above_floor(self._model, self._data.qpos, rail.object.name)
        mujoco.mj_step(self._model, self._data, round(CLOSES_S / self._model.opt.timestep))
        mujoco.mj_forward(self._model, self._data)
        self._rest = np.empty(mujoco.mj_stateSize(self._model, _STATE))
        mujoco.mj_getState(self._model, self._data, self._rest, _STATE)
        back = -matrix(self._pose[3:]) @ np.array(rail.approach) * [1.0, 1.0, 0.0]
        if (length := np.linalg.norm(back)) < _NOTHING:
            raise UsageError(f"{rail.geom} is approached from above: that is no way to drag it")
        self._back = back / length

    def drag(self) -> Drag:
        """Find the least pull that moves it."""
        slides, force = 0.0, np.empty(6)
        for i, friction in enumerate(self._data.contact.friction[:, 0]):
            mujoco.mj_contactForce(self._model, self._data, i, force)
            slides += float(friction * force[0])
        moves = most(lambda pull: self._pull(pull)[0] <= SLIPS) + 1
        _, tilt, turn = self._pull(moves)
        return Drag(
            slides, moves, "tips" if tilt > TURNS else "turns" if turn > TURNS else "slides"
        )

    def _pull(self, force: float) -> tuple[float, float, float]:
        """Pull at the rail; return how far the object moved [m], tilted and turned in all [deg]."""
        model, data = self._model, self._data
        mujoco.mj_setState(model, data, self._rest, _STATE)
        mujoco.mj_forward(model, data)
        start, before = self._pose[:3].copy(), matrix(self._pose[3:])
        moved = 0.0
        for share in _rising():
            _apply(model, data, self._geom, share * force * self._back)
            mujoco.mj_step(model, data, round(TICK / model.opt.timestep))
            moved = float(self._back @ (self._pose[:3] - start))
            if moved > SLIPS:
                break
        turned = matrix(self._pose[3:]) @ before.T
        cosines = np.clip((turned[2, 2], (np.trace(turned) - 1.0) / 2.0), -1.0, 1.0)
        tilt, turn = np.degrees(np.arccos(cosines)).tolist()
        return moved, tilt, turn


def most(holds: Callable[[float], bool]) -> int:
    """Return the largest force [N] up to which all that were tried hold."""
    force = 0
    for step in STEPS:
        while force + step <= MOST and holds(force + step):
            force += step
    return force


def find_bar(model: mujoco.MjModel, name: str) -> int:
    """Find a geom that is a bar; an error names those of the same object that are."""
    bars = np.flatnonzero(np.isin(model.geom_type, _BARS)).tolist()
    names = {model.geom(bar).name: bar for bar in bars}
    own = [known for known in names if known.split("/")[0] == name.split("/")[0]]
    if name not in own:
        raise unknown("bar", name, own)
    return names[name]


def _rising() -> np.ndarray:
    """Share of a pull that acts in each tick: it comes slowly, and stays."""
    ticks = np.arange(1, round((RISES_S + HELD_S) / TICK) + 1)
    return np.minimum(1.0, ticks * TICK / RISES_S)


def _apply(model: mujoco.MjModel, data: mujoco.MjData, geom: int, force: np.ndarray) -> None:
    """Pull at a geom's middle with a force (3,) [N], until this is called again."""
    data.qfrc_applied[:] = 0.0
    point, body = data.geom_xpos[geom], int(model.geom_bodyid[geom])
    mujoco.mj_applyFT(model, data, force, np.zeros(3), point, body, data.qfrc_applied)


def _hold_all_but_jaw(spec: mujoco.MjSpec, options: ModelOptions) -> mujoco.MjModel:
    """Compile a scene whose robot hangs in the world, all of its joints gone but the jaw's."""
    robot = spec.body(SPOT.base)
    for actuator in [a for a in spec.actuators if a.name != JAW]:
        spec.delete(actuator)
    for joint in [j for j in robot.find_all("joint") if j.name != JAW]:
        spec.delete(joint)
    # Contacts of a body with its parent are left out, but not where the parent cannot move.
    spec.add_exclude(bodyname1=WRIST, bodyname2=FINGER)
    robot.pos, spec.option.gravity = [0.0, 0.0, FAR], [0.0, 0.0, 0.0]
    return compile_without(spec, robot, options.departures)


def _long_axis(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> np.ndarray:
    """Direction (3,) in which a bar lies, world."""
    column = np.argmax(model.geom_size[geom]) if model.geom_type[geom] == _BOX else 2
    return data.geom_xmat[geom].reshape(3, 3)[:, column]
