"""Composing a robot, objects and fixtures into one MuJoCo model."""

import warnings
from dataclasses import dataclass

import mujoco

from sumo_dist.errors import UsageError
from sumo_dist.model.departures import LEAN, compile_without
from sumo_dist.model.files import find_model, read_model, valid_model
from sumo_dist.model.part import Part, read_part
from sumo_dist.model.references import count_referring, refer
from sumo_dist.model.settings import carry_out_settings, settings_left_out, take_settings
from sumo_dist.robots.robot import Robot

FLOOR = "fixtures/floor.xml"
TAKEN = {"floor": "that is the scene's own", "world": "that is the world's body", "": "it is empty"}


@dataclass(frozen=True)
class SceneObject:
    """Something in the scene that is not the robot.

    One file can be placed several times: whatever it names is called `<name>/<its name>` in the
    scene, except an object's root body, `<name>`, and that body's free joint, `<name>_joint`.
    Bodies and joints without a name are called `<name>/body_<number>`, `<name>/joint_<number>`.

    Attributes:
        name: unique in the scene.
        mjcf: model file, MJCF or URDF: below assets/, an absolute path or one in `~`.
    """

    name: str
    mjcf: str


@dataclass(frozen=True)
class Scene:
    """A robot on a floor among objects. qpos and qvel hold the robot, then the objects in order.

    Attributes:
        robot: its elements keep the names of its file.
        objects: move freely; see `part.read_part` for what becomes of a file.
        fixtures: stay where their files put them, or hang there by joints of their own.
        floor_friction: sliding friction of the floor with whatever has no higher priority.
        floor_priority: of that friction, as MuJoCo's geoms have it.
    """

    robot: Robot
    objects: tuple[SceneObject, ...] = ()
    fixtures: tuple[SceneObject, ...] = ()
    floor_friction: float = 0.7
    floor_priority: int = 5

    def __post_init__(self) -> None:
        names = [thing.name for thing in (*self.objects, *self.fixtures)]
        if taken := [name for name in names if name in TAKEN]:
            raise UsageError(
                f"scene: no object or fixture can be called {taken[0]!r}: {TAKEN[taken[0]]}"
            )
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise UsageError(
                f"scene: objects and fixtures need distinct names, got {repeated} twice"
            )


@dataclass(frozen=True)
class ModelOptions:
    """In what two models of one scene may differ.

    Attributes:
        timestep: of the physics [s].
        fluid_density: of the medium, whose drag acts on every body [kg/m^3].
        visuals: keep what is only seen; without it a step is cheaper and has the same result.
        departures: what the model does without, see `departures.compile_without`.
    """

    timestep: float
    fluid_density: float
    visuals: bool = False
    departures: tuple[str, ...] = ()


PLANT = ModelOptions(timestep=0.01, fluid_density=1.0, visuals=True)
PLANNING = ModelOptions(timestep=0.02, fluid_density=0.0, departures=LEAN)


def build_spec(scene: Scene, options: ModelOptions) -> mujoco.MjSpec:
    """Compose a scene, departures left out.

    Raises:
        UsageError: a file is missing, is no valid model or holds what cannot work in a scene, or
            two elements have the same name.
    """
    return _compose(scene, options)[0]


def compile_model(scene: Scene, options: ModelOptions) -> mujoco.MjModel:
    """Compose and compile a scene; errors as for build_spec."""
    spec = build_spec(scene, options)
    with valid_model("the scene"):
        return compile_without(spec, spec.body(scene.robot.base), options.departures)


def remarks(scene: Scene) -> list[str]:
    """What the scene does not take of its files, and what MuJoCo warns of: a line for each file."""
    return _compose(scene, PLANT)[1]


def _compose(scene: Scene, options: ModelOptions) -> tuple[mujoco.MjSpec, list[str]]:
    # The robot is the parent, so that its names need no prefix.
    spec, floor = (read_model(find_model(file), file) for file in (scene.robot.mjcf, FLOOR))
    with valid_model(scene.robot.mjcf):
        carry_out_settings(spec)
        spec.compile()  # alone, so that an error names its file
    _check_names(scene, spec)
    _set_options(spec, options)
    with valid_model("the scene"):
        _attach(spec, Part(floor), "floor", free=False)
        ground = spec.geom("floor/ground")
        ground.friction[0], ground.priority = scene.floor_friction, scene.floor_priority
        said = [_add(spec, thing, free=True) for thing in scene.objects]
        said += [_add(spec, thing, free=False) for thing in scene.fixtures]
    return spec, [line for line in said if line]


def _check_names(scene: Scene, robot: mujoco.MjSpec) -> None:
    """See that what is called after an object is not in the robot."""
    for thing in scene.objects:
        names = {"body": thing.name, "joint": f"{thing.name}_joint"}
        for kind, name in names.items():
            if getattr(robot, kind)(name) is not None:
                raise UsageError(
                    f"scene: object {thing.name!r} needs another name: {name!r} is a {kind} of "
                    f"robot {scene.robot.name!r}"
                )


def _add(spec: mujoco.MjSpec, thing: SceneObject, free: bool) -> str:
    """Add an object (free) or a fixture; return what there is to say about its file."""
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        part = read_part(thing.mjcf, thing.name, free)
        words = [*part.remarks, *settings_left_out(part.spec, spec)]
        words += _attach(spec, part, thing.name, free)
    words += [f"MuJoCo warns: {' '.join(str(w.message).split())}" for w in warned]
    return f"{thing.mjcf}: {'; '.join(words)}" if words else ""


def _attach(spec: mujoco.MjSpec, part: Part, name: str, free: bool) -> list[str]:
    """Attach a part under its name; return which of its elements referred to what is left out."""
    expected = count_referring(spec) + part.referring
    root, joint = part.root, part.root.joints[0] if part.root else None
    moved = [(refer(part.spec, floor), "floor/ground") for floor in part.floors]
    if root and joint:
        moved += [(refer(part.spec, root), name), (refer(part.spec, joint), f"{name}_joint")]
    below = spec.worldbody
    if free and not root:  # all of it moves as one
        below = spec.worldbody.add_body(name=name)
        below.add_freejoint(name=f"{name}_joint")
    take_settings(part.spec, spec)
    spec.attach(part.spec, prefix=f"{name}/", frame=below.add_frame())
    if root and joint:
        root.name, joint.name = name, f"{name}_joint"
    for to, target in moved:
        to(target)
    for floor in part.floors:
        spec.delete(floor)
    lost = expected - count_referring(spec)
    gone = ", ".join(f"{count} of its {kind}" for kind, count in lost.items())
    return [f"left out {gone}: they refer to what is left out"] if lost else []


def _set_options(spec: mujoco.MjSpec, options: ModelOptions) -> None:
    """Set what the parts of a scene share."""
    spec.option.timestep = options.timestep
    spec.option.density = options.fluid_density
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    # An automatic reset would turn a diverged rollout into a finite, cheap one.
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_AUTORESET

    spec.compiler.discardvisual = not options.visuals
    spec.stat.center, spec.stat.extent = [0.0, 0.0, 0.3], 3.0  # what a free camera first frames [m]
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    spec.visual.headlight.ambient = [0.3, 0.3, 0.3]
    spec.visual.quality.shadowsize = 4096
    spec.visual.map.shadowclip = 8.0  # in extents: the shadow's edge beyond that of the floor
