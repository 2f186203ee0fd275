"""`sumo-dist bench rollout`: what policy-in-the-loop rollouts cost, and what the options change."""

import json
import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sumo_dist.bench.engine import checked_engine
from sumo_dist.bench.layout import heading, markdown
from sumo_dist.bench.measure.feet import full_feet
from sumo_dist.bench.measure.moment import Moment
from sumo_dist.bench.measure.reference import Reference
from sumo_dist.bench.measure.variant import Round, Variant, interleave, one_round, row
from sumo_dist.errors import UsageError
from sumo_dist.math import rotations
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import ModelOptions
from sumo_dist.planner.problem import Problem
from sumo_dist.policies.hold import hold_targets
from sumo_dist.provenance import cores, timing_provenance
from sumo_dist.rollout import make_controller, make_engine
from sumo_dist.rollout.interface import Controller, Engine, Rollouts
from sumo_dist.tasks import load_task

ROLLOUTS = 32

FULL = Variant("engine", 1.0, 0.01)  # the plant's own physics
NO_DRAG = Variant("engine", 0.0, 0.01)
COARSE = Variant("engine", 1.0, 0.02)
PLANNING = Variant("engine", 0.0, 0.02)  # the planner's default
PHYSICS = Variant("physics only", 1.0, 0.01)
FALLBACK = Variant("fallback", 0.0, 0.02)
REFERENCE = Variant("reference", 1.0, 0.01)  # as shipped
REFERENCE_NO_DRAG = Variant("reference", 0.0, 0.01)
FINE = Variant("engine", 1.0, 0.005)  # of G1 alone: half the plant's step
FULL_FEET = Variant("full feet", 1.0, 0.01)  # of G1 alone: seven capsules a foot

COMMON = (FULL, NO_DRAG, COARSE, PLANNING, FALLBACK)
ENGINES = {"spot": COMMON, "g1": (*COMMON, FINE, FULL_FEET)}
POLICY_TARGET = {"spot": "<= 1.15", "g1": "<= 1.2"}

# Processor time of the first over that of the second, medians; and what it should be.
RATIOS = {
    "policy_over_physics": (FULL, PHYSICS, ""),  # POLICY_TARGET
    "cpu_speedup_vs_reference": (REFERENCE, NO_DRAG, ">= 2"),
    "cpu_speedup_vs_reference_coarse": (REFERENCE, PLANNING, ">= 3"),
    "cpu_speedup_same_physics": (REFERENCE_NO_DRAG, NO_DRAG, "-"),
    "cpu_speedup_coarse_vs_reference_without_drag": (REFERENCE_NO_DRAG, PLANNING, "-"),
    "fallback_over_engine": (FALLBACK, PLANNING, "-"),
    "full_feet_over_three_capsules": (FULL_FEET, FULL, "-"),
    "half_step_over_plant": (FINE, FULL, "-"),
}
DEVIATIONS = (
    (NO_DRAG, FULL),
    (COARSE, FULL),
    (PLANNING, FULL),
    (PHYSICS, FULL),
    (FALLBACK, PLANNING),
    (REFERENCE, FULL),
    (REFERENCE_NO_DRAG, NO_DRAG),
    (FINE, FULL),
    (FULL_FEET, FULL),
)

STATS = ("median", "min")
MOVED = ("position median [m]", "max [m]", "angle median [deg]", "max [deg]")


@dataclass(frozen=True)
class Options:
    """Options of `bench rollout`.

    Attributes:
        robot: spot or g1.
        reference: also time the backend in the judo-rai wheel, in an environment of its own.
        json: print one JSON object.
        repeats: timed rounds of every variant.
        threads: of our engines; by default one for each core.
        engine: auto, native, native-portable or fallback; auto does not take the fallback.
    """

    robot: str = "spot"
    reference: bool = False
    json: bool = False
    repeats: int = 40
    threads: int | None = None
    engine: str = "auto"


def main(options: Options) -> int:
    """Time, and print tables or one JSON object."""
    if options.repeats < 1:
        raise UsageError(f"repeats must be at least 1, got {options.repeats}")
    if options.reference and options.robot != "spot":
        raise UsageError("the reference is of Spot: leave out --reference or --robot")
    threads = cores() if options.threads is None else options.threads
    name, build = checked_engine(options.engine)
    about, moment = timing_provenance(), Moment.of(options.robot)
    rounds = measure(moment, options, threads)
    result = {
        **about,
        "engine": name,
        "engine_build": build,
        "threads": threads,
        "rollouts": ROLLOUTS,
        "repeats": options.repeats,
        **ratios(rounds),
        "deviations": deviations(moment, rounds),
        "rows": [row(variant, of_it) for variant, of_it in rounds.items()],
    }
    print(json.dumps(result, indent=1) if options.json else text(options, result))
    return 0


def measure(moment: Moment, options: Options, threads: int) -> dict[Variant, list[Round]]:
    """Time every variant in turn, in this process and the reference's."""
    commands = moment.commands(ROLLOUTS)
    with ExitStack() as stack:
        variants: dict[Variant, Callable[[], Round]] = {}
        for variant in ENGINES[options.robot]:
            kind = "fallback" if variant == FALLBACK else options.engine
            engine = stack.enter_context(problem(moment, variant).engine(threads, kind))
            variants[variant] = partial(one_round, engine, moment.state, moment.memory, commands)
        physics, targets = physics_only(moment, commands, options.engine, threads)
        stack.enter_context(physics)
        no_memory = np.zeros(0, np.float32)
        variants[PHYSICS] = partial(one_round, physics, moment.state, no_memory, targets)
        if options.reference:
            reference = stack.enter_context(Reference(moment, commands, _say))
            for variant in (REFERENCE, REFERENCE_NO_DRAG):
                variants[variant] = partial(reference.round, variant.density)
        return interleave(variants, options.repeats, _say)


def problem(moment: Moment, variant: Variant) -> Problem:
    """Compile the moment's task with a variant's physics."""
    task, options = load_task(moment.task), ModelOptions(variant.timestep, variant.density)
    if variant.engine != "full feet":
        return Problem.build(task, options)
    with TemporaryDirectory() as folder:
        scene = replace(task.scene, robot=full_feet(task.scene.robot, Path(folder)))
        return Problem.build(replace(task, scene=scene), options)


def physics_only(
    moment: Moment, commands: np.ndarray, kind: str, threads: int
) -> tuple[Engine, np.ndarray]:
    """Return an engine without a policy and the joint targets (B, T, nu) for the same motion."""
    with_policy = problem(moment, FULL)
    with with_policy.engine(threads, kind) as engine:
        rollouts = engine.rollout(moment.state, moment.memory, commands)
    controller = make_controller(with_policy.policy, with_policy.model, kind)
    targets = joint_targets(controller, moment, commands, rollouts, with_policy.model.nq)
    policy = hold_targets(with_policy.policy.contract)
    return make_engine(with_policy.model, policy, with_policy.layout.refs, threads, kind), targets


def joint_targets(
    controller: Controller, moment: Moment, commands: np.ndarray, rollouts: Rollouts, nq: int
) -> np.ndarray:
    """Ask the policy again for the joint targets (B, T, nu) [rad] that it gave in rollouts."""
    targets = []
    for row_commands, states in zip(commands, rollouts.states, strict=True):
        memory, before = moment.memory, [moment.state, *states[:-1]]
        for command, state in zip(row_commands, before, strict=True):
            target, memory = controller.step(state[:nq], state[nq:], command, memory)
            targets.append(target)
    return np.array(targets).reshape(*commands.shape[:2], -1)


def ratios(rounds: Mapping[Variant, list[Round]]) -> dict[str, float | None]:
    """Ratios of the medians of processor time; None where the reference was not asked for."""
    cpu = {variant: np.median([r.cpu_ms for r in of_it]) for variant, of_it in rounds.items()}
    return {
        name: round(float(cpu[over] / cpu[under]), 3) if over in cpu and under in cpu else None
        for name, (over, under, _) in RATIOS.items()
    }


def deviations(moment: Moment, rounds: Mapping[Variant, list[Round]]) -> list[dict[str, Any]]:
    """How far the object's final poses are from those of another variant."""
    task = load_task(moment.task)
    index = StateIndex(problem(moment, FULL).model)
    pose = index.pose(task.frames["object"].name)
    final = {variant: of_it[-1].final[:, pose] for variant, of_it in rounds.items()}
    return [
        {"variant": variant._asdict(), "against": other._asdict()}
        | difference(final[variant], final[other])
        for variant, other in DEVIATIONS
        if variant in final
    ]


def difference(poses: np.ndarray, others: np.ndarray) -> dict[str, float]:
    """Distances [m] and angles [deg] between poses (B, 7), over the rollouts that both finished."""
    both = np.isfinite(poses).all(axis=1) & np.isfinite(others).all(axis=1)
    poses, others = poses[both], others[both]
    distance = np.linalg.norm(poses[:, :3] - others[:, :3], axis=1)
    turn = rotations.multiply(rotations.conjugate(others[:, 3:]), poses[:, 3:])
    angle = np.degrees(np.linalg.norm(rotations.to_rotation_vector(turn), axis=1))
    return {
        "position_m_median": round(float(np.median(distance)), 6),
        "position_m_max": round(float(distance.max()), 6),
        "angle_deg_median": round(float(np.median(angle)), 4),
        "angle_deg_max": round(float(angle.max()), 4),
    }


def text(options: Options, result: Mapping[str, Any]) -> str:
    """Lay out what was measured."""
    command = "bench rollout"
    command += f" --robot {options.robot}" * (options.robot != "spot")
    command += " --reference" * options.reference
    times = [
        (
            _name(row),
            *(f"{row[f'{clock}_ms_{kind}']:.1f}" for clock in ("cpu", "wall") for kind in STATS),
            str(row["diverged"]),
        )
        for row in result["rows"]
    ]
    found = [
        (name, f"{over} / {under}", f"{result[name]:.2f}", target or POLICY_TARGET[options.robot])
        for name, (over, under, target) in RATIOS.items()
        if result[name] is not None
    ]
    moved = [
        (
            _name(d["variant"]),
            _name(d["against"]),
            f"{d['position_m_median']:.4f}",
            f"{d['position_m_max']:.4f}",
            f"{d['angle_deg_median']:.2f}",
            f"{d['angle_deg_max']:.2f}",
        )
        for d in result["deviations"]
    ]
    return "\n\n".join(
        (
            heading(command, result),
            f"{result['rollouts']} rollouts of 1.5 s from one instant of walking and pushing, "
            f"{result['engine']} with {result['threads']} threads, {result['repeats']} rounds of "
            "all variants in turn. Times in ms.",
            markdown(("variant", "CPU median", "min", "wall median", "min", "diverged"), times),
            "Ratios of the medians of CPU time:",
            markdown(("ratio", "of", "value", "target"), found),
            "Where the object ends, against another variant, over the rollouts:",
            markdown(("variant", "against", *MOVED), moved),
        )
    )


def _name(variant: Mapping[str, Any]) -> str:
    return str(Variant(*(variant[key] for key in Variant._fields)))


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
