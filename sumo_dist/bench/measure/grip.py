"""`sumo-dist bench grip`: at what pull Spot's gripper loses what it holds, in plant and plan."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from sumo_dist.bench.layout import Result, run_bench, table
from sumo_dist.bench.measure.hold import (
    ALONG,
    HELD_S,
    MOST,
    OUT,
    RISES_S,
    SLIPS,
    Bar,
    Dragged,
    Grip,
    Rail,
    Shape,
)
from sumo_dist.errors import UsageError
from sumo_dist.model.scene import PLANT, ModelOptions, SceneObject
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import planning_options
from sumo_dist.terminal import say

# What the project's objects have to be held by; one line each.
RAILS = (
    Rail(SceneObject("rack", "objects/rack.xml"), "cross_rear"),
    Rail(SceneObject("heavy_rack", "objects/heavy_rack.xml"), "cross_rear"),
    Rail(
        SceneObject("barrier", "objects/barrier.xml"),
        "left_end",
        approach=(1.0, 0.0, 0.0),
        floor_friction=1.0,
    ),
)

SHAPES: tuple[tuple[Shape, float], ...] = (("square", 0.04), ("round", 0.03), ("square", 0.02))
FRICTIONS = ((1.0, 3), (0.3, 6), (0.5, 6), (1.0, 6))  # and priorities: at 3 the robot's own acts
BARS = (
    *(Bar(shape, wide, *friction) for shape, wide in SHAPES for friction in FRICTIONS),
    *(Bar("round", wide) for wide in (0.02, 0.04, 0.05)),
    *(Bar("round", 0.03, priority=4), Bar("round", 0.03, condim=4), Bar("round", 0.03, condim=6)),
    *(Bar(shape, wide, solref=0.04) for shape, wide in SHAPES),
    *(Bar("round", 0.03, mass=mass) for mass in (5.0, 20.0)),
)
TYPICAL = Bar("round", 0.03)

PULL = 50.0  # under which the creep is measured, about that of a drag [N]
FINE = 0.001  # a time step at which a contact is as good as exact [s]
PLANTS, PLANS = "plant", "planning"

HELD = {
    "friction, priority, condim, solref": "{plant[stated]}",
    "acts": "{plant[friction]:g}",
    "mass [kg]": "{plant[mass]:.1f}",
    "jaw [rad]": "{plant[angle]:.2f}",
    "squeeze [N]": "{plant[squeeze]:.0f} ({planning[squeeze]:.0f})",
    "held out of the jaw [N]": "{plant[out]} ({planning[out]})",
    "along the bar [N]": "{plant[along]} ({planning[along]})",
    f"creep at {PULL:g} N [mm/s]": "{plant[creeps]} ({planning[creeps]})",
    "deepest [mm]": "{plant[deepest_mm]:.1f} ({planning[deepest_mm]:.1f})",
}
NEEDED = {
    "floor's friction x weight [N]": "{slides:.0f}",
    "moves at [N]": "{moves}",
    "and": "{how}",
}
MODELS = {
    "model": "{model}",
    "held out of the jaw [N]": "{out}",
    "along the bar [N]": "{along}",
    f"creep at {PULL:g} N [mm/s]": "{creeps}",
    "deepest [mm]": "{deepest_mm:.2f}",
}


@dataclass(frozen=True)
class Options:
    """Options of `bench grip`.

    Attributes:
        json: print one JSON object.
        mjcf: an object's model file, to measure only a bar of it.
        part: that bar: the name of a capsule, a cylinder or a box in the file.
        approach: where the gripper points when it takes that bar, in the object's frame.
        floor_friction: of the floor that the object is dragged over.
    """

    json: bool = False
    mjcf: str = ""
    part: str = ""
    approach: tuple[float, float, float] = OUT
    floor_friction: float = 0.7

    def __post_init__(self) -> None:
        if bool(self.mjcf) != bool(self.part):
            raise UsageError("a bar of one's own needs both: --mjcf FILE --part GEOM")

    @property
    def rails(self) -> Sequence[Rail]:
        """Bars of objects to measure."""
        if not self.mjcf:
            return RAILS
        here = Path(self.mjcf).absolute()
        file = str(here) if here.is_file() else self.mjcf
        thing = SceneObject(here.stem, file)
        return (Rail(thing, self.part, self.approach, self.floor_friction),)


def main(options: Options) -> int:
    """Measure, and print tables or one JSON object."""
    own = f" --mjcf {options.mjcf} --part {options.part}"
    own += " --approach {:g} {:g} {:g}".format(*options.approach)
    own += f" --floor-friction {options.floor_friction:g}"
    command = f"bench grip{own if options.mjcf else ''}"
    run_bench(command, options.json, partial(measure, options), text)
    return 0


def measure(options: Options) -> Result:
    """Close the jaw on every bar in every model, and pull."""
    models = planning_and_plant()
    both = {name: models[name] for name in (PLANTS, PLANS)}
    found: dict[str, Any] = {"bars": [], "models": [], "rails": []}
    if not options.mjcf:
        found["bars"] = [held(bar, both) for bar in BARS]
        typical = held(TYPICAL, models)
        found["models"] = [{"model": name, **typical[name]} for name in models]
    for rail in options.rails:
        found["rails"].append({**held(rail, both), **needed(rail)})
    return found


def planning_and_plant() -> dict[str, ModelOptions]:
    """Return models of the world by name: plant's, planner's, two between them, a fine one."""
    plant = replace(PLANT, visuals=False)
    plan = planning_options(PlannerConfig())
    return {
        PLANTS: plant,
        f"plant at {plan.timestep:g} s": replace(plant, timestep=plan.timestep),
        f"planning at {plant.timestep:g} s": replace(plan, timestep=plant.timestep),
        PLANS: plan,
        f"plant at {FINE:g} s": replace(plant, timestep=FINE),
    }


def held(thing: Bar | Rail, models: Mapping[str, ModelOptions]) -> dict[str, Any]:
    """Measure a hold in several models; return the bar's name and what each model finds."""
    say(f"holding {thing.name}")
    found = {name: hold(thing, options) for name, options in models.items()}
    return {"name": thing.name, **found}


def hold(thing: Bar | Rail, options: ModelOptions) -> dict[str, Any]:
    """Measure a hold in one model."""
    grip = Grip(thing, options)
    pull = grip.pull(PULL, OUT)
    creep = 1e3 * pull.moved / (RISES_S + HELD_S)
    return {
        "stated": "{:g}, {}, {}, {:g}".format(*grip.stated),
        "mass": grip.mass,
        "friction": grip.friction,
        "angle": grip.angle,
        "torque": grip.torque,
        "squeeze": grip.squeeze,
        "out": grip.holds(OUT),
        "along": grip.holds(ALONG),
        "creeps": f"{creep:.1f}" if pull.moved <= SLIPS else "slips",
        "deepest_mm": 1e3 * pull.deepest,
    }


def needed(rail: Rail) -> dict[str, Any]:
    """Measure what it takes to drag the object that a rail belongs to."""
    return Dragged(rail).drag()._asdict()


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    yield (
        f"The jaw closes on a bar, which is pulled for {HELD_S:g} s; held is the largest force up "
        f"to which it moves less than {1e3 * SLIPS:g} mm, at most {MOST} N. In brackets: in the "
        "planning model."
    )
    if result["bars"]:
        yield "Bars that hang on nothing:"
        yield table({"bar": "{name}", **HELD}, result["bars"])
        yield f"What of the planning model makes the difference, {TYPICAL.name}, friction 1:"
        yield table(MODELS, result["models"])
    yield "Bars of objects, and what it takes to drag the object by it over the floor:"
    yield table({"bar": "{name}", **HELD, **NEEDED}, result["rails"])
