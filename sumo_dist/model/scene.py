"""Composing a robot, objects and fixtures into one MuJoCo model."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import mujoco

from sumo_dist.errors import UsageError, unknown
from sumo_dist.robots.robot import Robot

ASSETS = Path(__file__).parents[1] / "assets"
FLOOR = "fixtures/floor.xml"


@dataclass(frozen=True)
class SceneObject:
    """Something in the scene that is not the robot.

    One file can be placed several times: whatever it names is called `<name>/<its name>` in the
    scene, except an object's root body, `<name>`, and that body's free joint, `<name>_joint`.

    Attributes:
        name: unique in the scene.
        mjcf: model file, below assets/ or an absolute path.
    """

    name: str
    mjcf: str


@dataclass(frozen=True)
class Scene:
    """A robot on a floor among objects. qpos and qvel hold the robot, then the objects in order.

    Attributes:
        robot: its elements keep the names of its file.
        objects: move freely; each file has one top-level body.
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
        names = ["floor", *(thing.name for thing in (*self.objects, *self.fixtures))]
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
    """

    timestep: float
    fluid_density: float
    visuals: bool = False


PLANT = ModelOptions(timestep=0.01, fluid_density=1.0, visuals=True)
PLANNING = ModelOptions(timestep=0.02, fluid_density=0.0)


def build_spec(scene: Scene, options: ModelOptions) -> mujoco.MjSpec:
    """Compose a scene.

    Raises:
        UsageError: a file is missing or is no valid model, or two elements have the same name.
    """
    spec = _load(scene.robot.mjcf)  # the parent, so that its names need no prefix
    _set_options(spec, options)
    with _invalid_model("the scene"):
        _attach(spec, _load(FLOOR), "floor")
        ground = spec.geom("floor/ground")
        ground.friction[0], ground.priority = scene.floor_friction, scene.floor_priority
        for thing in scene.objects:
            child = _load(thing.mjcf)
            root, joint = _free_body(child, thing.mjcf)
            _attach(spec, child, thing.name)
            root.name, joint.name = thing.name, f"{thing.name}_joint"
        for fixture in scene.fixtures:
            _attach(spec, _load(fixture.mjcf), fixture.name)
    return spec


def compile_model(scene: Scene, options: ModelOptions) -> mujoco.MjModel:
    """Compose and compile a scene; errors as for build_spec."""
    spec = build_spec(scene, options)
    with _invalid_model("the scene"):
        return spec.compile()


@contextmanager
def _invalid_model(what: str) -> Iterator[None]:
    """Turn MuJoCo's complaint into a one-line UsageError that names its subject."""
    try:
        yield
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise UsageError(f"{what} is not a valid MuJoCo model: {reason}") from None


def _load(mjcf: str) -> mujoco.MjSpec:
    path = ASSETS / mjcf
    if not path.is_file():
        shipped = (str(p.relative_to(ASSETS)) for p in ASSETS.rglob("*.xml"))
        raise unknown("model file", mjcf, ["/an/absolute/path.xml", *shipped])
    with _invalid_model(mjcf):
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compile()  # alone, so that an error names its file
    return spec


def _free_body(spec: mujoco.MjSpec, mjcf: str) -> tuple[mujoco.MjsBody, mujoco.MjsJoint]:
    """Return an object's root and its free joint, which is added if the file has none."""
    bodies = spec.worldbody.bodies
    if len(bodies) != 1:
        raise UsageError(f"{mjcf}: an object has one top-level body, found {len(bodies)}")
    joint = bodies[0].first_joint() or bodies[0].add_freejoint()
    if joint.type != mujoco.mjtJoint.mjJNT_FREE:
        raise UsageError(f"{mjcf}: an object's top-level body has a free joint or none")
    return bodies[0], joint


def _attach(spec: mujoco.MjSpec, child: mujoco.MjSpec, name: str) -> None:
    # The parent's settings win anyway; a child that differs would make MuJoCo warn.
    child.option, child.visual, child.stat = spec.option, spec.visual, spec.stat
    spec.attach(child, prefix=f"{name}/", frame=spec.worldbody.add_frame())


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
