"""`sumo-dist bench rollout`: what policy-in-the-loop rollouts cost, and what the options change."""

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sumo_dist.bench import layout
from sumo_dist.bench.layout import Result
from sumo_dist.bench.measure.reference import Reference
from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.bench.measure.variant import Round, Variant, interleave, row, timed
from sumo_dist.errors import UsageError
from sumo_dist.math import rotations
from sumo_dist.model.departures import LEAN
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import ModelOptions
from sumo_dist.planner.problem import Problem
from sumo_dist.policies.hold import hold_targets
from sumo_dist.provenance import cores
from sumo_dist.rollout import make_controller, make_engine
from sumo_dist.rollout.interface import Engine
from sumo_dist.tasks import load_task
from sumo_dist.terminal import say

ROLLOUTS = 32

FULL = Variant("engine", 1.0, 0.01)  # the plant's own physics
NO_DRAG = Variant("engine", 0.0, 0.01)
COARSE = Variant("engine", 1.0, 0.02)
NO_DRAG_COARSE = Variant("engine", 0.0, 0.02)
PLANNING = Variant("engine", 0.0, 0.02, lean=True)  # the planner's default
FINE = Variant("engine", 1.0, 0.005)  # half the plant's step; of G1 alone
PHYSICS = Variant("physics only", 1.0, 0.01)
FALLBACK = Variant("fallback", 0.0, 0.02, lean=True)
REFERENCE = Variant("reference", 1.0, 0.01)  # as shipped
REFERENCE_NO_DRAG = Variant("reference", 0.0, 0.01)

ENGINES = {
    "spot": (FULL, NO_DRAG, COARSE, NO_DRAG_COARSE, PLANNING, FALLBACK),
    "g1": (FULL, NO_DRAG, COARSE, NO_DRAG_COARSE, PLANNING, FALLBACK, FINE),
}

# Processor time of the first over that of the second, medians; and what it should be.
RATIOS = {
    "policy_over_physics": (FULL, PHYSICS, "<= 1.15, G1 1.2"),
    "cpu_speedup_vs_reference": (REFERENCE, NO_DRAG, ">= 2"),
    "cpu_speedup_vs_reference_coarse": (REFERENCE, NO_DRAG_COARSE, ">= 3"),
    "cpu_speedup_vs_reference_planning": (REFERENCE, PLANNING, ">= 4"),
    "cpu_speedup_same_physics": (REFERENCE_NO_DRAG, NO_DRAG, "-"),
    "cpu_speedup_coarse_vs_reference_without_drag": (REFERENCE_NO_DRAG, NO_DRAG_COARSE, "-"),
    "lean_over_full": (PLANNING, NO_DRAG_COARSE, "<= 0.75"),
    "fallback_over_engine": (FALLBACK, PLANNING, "-"),
    "half_step_over_plant": (FINE, FULL, "-"),
}
DEVIATIONS = {  # variant -> the one that its final poses are compared with
    **dict.fromkeys((NO_DRAG, COARSE, NO_DRAG_COARSE, PLANNING, FINE, PHYSICS, REFERENCE), FULL),
    FALLBACK: PLANNING,
    REFERENCE_NO_DRAG: NO_DRAG,
}

TIMES = {
    "variant": "{name}",
    "CPU median": "{cpu_ms_median:.1f}",
    "CPU min": "{cpu_ms_min:.1f}",
    "wall median": "{wall_ms_median:.1f}",
    "wall min": "{wall_ms_min:.1f}",
    "diverged": "{diverged}",
}
MOVED = {
    "variant": "{name}",
    "against": "{other}",
    "position median [m]": "{position_m_median:.4f}",
    "max [m]": "{position_m_max:.4f}",
    "angle median [deg]": "{angle_deg_median:.2f}",
    "max [deg]": "{angle_deg_max:.2f}",
}


@dataclass(frozen=True)
class Options:
    """Options of `bench rollout`.

    Attributes:
        robot: spot or g1.
        reference: also time the backend in the judo-rai wheel; the interpreter of an environment
            that has it, see docs/results/bench_rollout.md.
        json: print one JSON object.
        repeats: timed rounds of every variant.
        threads: of our engines; by default one for each core.
        engine: auto, native, native-portable or fallback; auto does not take the fallback.
    """

    robot: str = "spot"
    reference: Path | None = None
    json: bool = False
    repeats: int = 40
    threads: int | None = None
    engine: str = "auto"

    def __post_init__(self) -> None:
        layout.check_at_least(1, repeats=self.repeats, threads=self.threads)
        if self.reference and self.robot != "spot":
            raise UsageError("the reference is of Spot: leave out --reference or --robot")


def main(options: Options) -> int:
    """Time, and print tables or one JSON object."""
    robot = f" --robot {options.robot}" if options.robot != "spot" else ""
    command = f"bench rollout{robot}{' --reference PYTHON' if options.reference else ''}"
    layout.run_bench(command, options.json, lambda: measure(options), text)
    return 0


def measure(options: Options) -> Result:
    """Time every variant in turn, in this process and the reference's."""
    threads, snapshot = options.threads or cores(), Snapshot.load(options.robot)
    name, build = layout.checked_engine(options.engine)
    commands = snapshot.commands(ROLLOUTS)
    with ExitStack() as stack:
        variants: dict[Variant, Callable[[], Round]] = {}
        for variant in ENGINES[options.robot]:
            kind = "fallback" if variant == FALLBACK else options.engine
            engine = stack.enter_context(problem(snapshot, variant).engine(threads, kind))
            variants[variant] = partial(one_round, engine, snapshot, snapshot.memory, commands)
        physics, targets = physics_only(snapshot, commands, options.engine, threads)
        stack.enter_context(physics)
        no_memory = np.zeros(0, np.float32)
        variants[PHYSICS] = partial(one_round, physics, snapshot, no_memory, targets)
        if options.reference:
            reference = stack.enter_context(Reference(options.reference, snapshot, commands))
            for variant in (REFERENCE, REFERENCE_NO_DRAG):
                variants[variant] = partial(reference.round, variant.density)
        rounds = interleave(variants, options.repeats, say)
    return {
        "engine": name,
        "engine_build": build,
        "threads": threads,
        "rollouts": ROLLOUTS,
        "repeats": options.repeats,
        **ratios(rounds),
        "deviations": deviations(snapshot, rounds),
        "rows": [row(variant, of_it) for variant, of_it in rounds.items()],
    }


def problem(snapshot: Snapshot, variant: Variant) -> Problem:
    """Compile the snapshot's task with a variant's physics."""
    departures = LEAN if variant.lean else ()
    options = ModelOptions(variant.timestep, variant.density, departures=departures)
    return Problem.build(load_task(snapshot.task), options)


def one_round(
    engine: Engine, snapshot: Snapshot, memory: np.ndarray, commands: np.ndarray
) -> Round:
    """Time one call of an engine of this process."""
    wall_ms, cpu_ms, rollouts = timed(lambda: engine.rollout(snapshot.state, memory, commands))
    return Round(wall_ms, cpu_ms, rollouts.states[:, -1])


def physics_only(
    snapshot: Snapshot, commands: np.ndarray, kind: str, threads: int
) -> tuple[Engine, np.ndarray]:
    """Return an engine without a policy and the joint targets (B, T, nu) for the same motion."""
    with_policy = problem(snapshot, FULL)
    with with_policy.engine(threads, kind) as engine:
        states = engine.rollout(snapshot.state, snapshot.memory, commands).states
    controller = make_controller(with_policy.policy, with_policy.model, kind)
    nq, targets = with_policy.model.nq, []
    for row_commands, row_states in zip(commands, states, strict=True):
        memory, before = snapshot.memory, [snapshot.state, *row_states[:-1]]
        for command, state in zip(row_commands, before, strict=True):
            target, memory = controller.step(state[:nq], state[nq:], command, memory)
            targets.append(target)
    policy = hold_targets(with_policy.policy.contract)
    engine = make_engine(with_policy.model, policy, with_policy.layout.refs, threads, kind)
    return engine, np.array(targets).reshape(*commands.shape[:2], -1)


def ratios(rounds: Mapping[Variant, list[Round]]) -> dict[str, float | None]:
    """Ratios of the medians of processor time; None where the reference was not asked for."""
    cpu = {variant: np.median([r.cpu_ms for r in of_it]) for variant, of_it in rounds.items()}
    return {
        name: round(float(cpu[over] / cpu[under]), 3) if over in cpu and under in cpu else None
        for name, (over, under, _) in RATIOS.items()
    }


def deviations(snapshot: Snapshot, rounds: Mapping[Variant, list[Round]]) -> list[dict[str, Any]]:
    """How far the object's final poses are from those of another variant."""
    index = StateIndex(problem(snapshot, FULL).model)
    pose = index.pose(load_task(snapshot.task).scene.objects[0].name)
    final = {variant: of_it[-1].final[:, pose] for variant, of_it in rounds.items()}
    return [
        {"variant": variant._asdict(), "against": other._asdict()}
        | difference(final[variant], final[other])
        for variant, other in DEVIATIONS.items()
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


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    yield (
        f"{result['rollouts']} rollouts of 1.5 s from one instant of walking and pushing, "
        f"{result['engine']} with {result['threads']} threads, {result['repeats']} rounds of "
        "all variants in turn. Times in ms."
    )
    yield layout.table(TIMES, [{**row, "name": _name(row)} for row in result["rows"]])
    yield "Ratios of the medians of CPU time:"
    found = [
        (name, f"{over} / {under}", f"{result[name]:.2f}", target)
        for name, (over, under, target) in RATIOS.items()
        if result[name] is not None
    ]
    yield layout.markdown(("ratio", "of", "value", "target"), found)
    yield "Where the object ends, against another variant, over the rollouts:"
    yield layout.table(
        MOVED,
        [
            {**d, "name": _name(d["variant"]), "other": _name(d["against"])}
            for d in result["deviations"]
        ],
    )


def _name(variant: Mapping[str, Any]) -> str:
    return str(Variant(*(variant[key] for key in Variant._fields)))
