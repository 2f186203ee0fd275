"""`sumo-dist bench policy`: does G1's policy stay on its feet, and how does it follow commands."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sumo_dist.bench.engine import checked_engine
from sumo_dist.bench.layout import heading, markdown
from sumo_dist.errors import UsageError, unknown
from sumo_dist.math import rotations
from sumo_dist.math.splines import evaluate, weights
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.model.settle import settled_stand
from sumo_dist.policies import load_policy
from sumo_dist.provenance import cores, timing_provenance
from sumo_dist.robots.compatibility import check
from sumo_dist.robots.g1 import BASE_LIMITS, G1, SIDES, g1_actions
from sumo_dist.rollout import make_engine
from sumo_dist.tasks.g1.terms import scene
from sumo_dist.timing import TICK

POLICIES = ("g1", "g1-ppo")
LONG_S, ARMS_S = 60.0, 20.0  # of a run [s]
RANDOM_RUNS, ARM_RUNS = 8, 40
HOLD_S = 3.0  # a random command of the base is kept this long [s]
KNOT_S = 0.5  # between the knots of arms that are moved, as between those of a plan [s]

_X, _Y, _W = BASE_LIMITS
STEADY = (
    *((0.0, 0.0, 0.0), (_X / 2, 0.0, 0.0), (_X, 0.0, 0.0), (-_X, 0.0, 0.0)),
    *((0.0, _Y, 0.0), (0.0, -_Y, 0.0), (0.0, 0.0, _W), (0.0, 0.0, -_W)),
    *((_X, _Y, _W), (-_X, -_Y, -_W), (_X, 0.0, -_W), (_X / 2, -_Y, _W / 2)),
)
SMALL = (0.06, 0.1, 0.2, 0.3)  # commands along each axis that show a dead band [m/s, rad/s]


@dataclass(frozen=True)
class Options:
    """Options of `bench policy`.

    Attributes:
        policy: g1 (FastSAC) or g1-ppo.
        json: print one JSON object.
        seed: of all random commands.
        engine: auto, native, native-portable or fallback; auto does not take the fallback.
    """

    policy: str = "g1"
    json: bool = False
    seed: int = 1
    engine: str = "auto"


class Walker:
    """Walks G1 over an empty floor with the plant's physics, many runs at once."""

    def __init__(self, policy: str, kind: str) -> None:
        """Load the policy and see that it fits."""
        self._robot = replace(G1, policy=policy)
        self._kind = kind
        self._model = compile_model(replace(scene(), robot=self._robot), PLANT)
        self._policy = load_policy(policy)
        check(self._policy.contract, self._robot, self._model)
        self._base = StateIndex(self._model).pose(G1.base)

    def walk(self, commands: np.ndarray) -> np.ndarray:
        """Follow commands (B, T, nc) from the stance; return the states (B, T, nq + nv)."""
        start = np.concatenate([settled_stand(self._robot), np.zeros(self._model.nv)])
        with make_engine(self._model, self._policy, (), cores(), self._kind) as engine:
            return engine.rollout(start, self._policy.initial_memory(), commands).states

    def falls(self, states: np.ndarray) -> int:
        """Count the runs in which the pelvis sinks to where the robot counts as fallen."""
        height = states[..., self._base][..., 2]
        return int((~(height > G1.fall_height)).any(axis=1).sum())  # NaN is a fall

    def velocity(self, states: np.ndarray) -> np.ndarray:
        """Mean vx, vy [m/s] in the base's frame and wz [rad/s] over the second half, (B, 3)."""
        half = states[:, states.shape[1] // 2 :]
        nq = self._model.nq
        quat, world = half[..., self._base][..., 3:], half[..., nq : nq + 3]
        inside = rotations.rotate_inverse(quat, world)
        return np.concatenate([inside[..., :2], half[..., nq + 5 : nq + 6]], axis=-1).mean(axis=1)


def main(options: Options) -> int:
    """Walk, and print tables or one JSON object; 1 if the policy fell too often."""
    if options.policy not in POLICIES:
        raise unknown("policy", options.policy, POLICIES)
    if options.seed < 0:
        raise UsageError(f"seed must not be negative, got {options.seed}")
    name, _ = checked_engine(options.engine)
    result = {
        **timing_provenance(),
        "engine": name,
        "policy": options.policy,
        "seed": options.seed,
        **measure(Walker(options.policy, options.engine), options.seed),
    }
    print(json.dumps(result, indent=1) if options.json else text(options, result))
    return 0 if all(run["falls"] <= run["allowed"] for run in result["runs"]) else 1


def measure(walker: Walker, seed: int) -> dict[str, Any]:
    """Count the falls of every kind of run, and measure how steady commands are followed."""
    rng = np.random.default_rng(seed)
    wandering, waving = wander(rng, RANDOM_RUNS, LONG_S), wave(rng, ARM_RUNS, ARMS_S)
    kinds = (
        ("steady commands", steady(np.array(STEADY), LONG_S), LONG_S, 0),
        ("random commands", wandering, LONG_S, 0),
        ("random commands, both arms moved by up to 1 rad", waving, ARMS_S, 1),
    )
    runs, followed = [], []
    for what, commands, seconds, allowed in kinds:
        states = walker.walk(commands)
        falls = walker.falls(states)
        runs.append(
            {
                "what": what,
                "runs": len(commands),
                "seconds": seconds,
                "falls": falls,
                "allowed": allowed,
            }
        )
        if what == "steady commands":
            followed += _pairs(np.array(STEADY), walker.velocity(states))
    small = np.array([size * axis for axis in np.eye(3) for size in SMALL])
    followed += _pairs(small, walker.velocity(walker.walk(steady(small, ARMS_S))))
    return {"runs": runs, "followed": followed}


def steady(velocities: np.ndarray, seconds: float) -> np.ndarray:
    """Keep base velocities (B, 3) for some seconds: commands (B, T, nc)."""
    actions = np.repeat(velocities[:, None], round(seconds / TICK), axis=1)
    return g1_actions().to_command(actions)


def wander(rng: np.random.Generator, runs: int, seconds: float) -> np.ndarray:
    """Draw a new base velocity within the limits every HOLD_S: commands (runs, T, nc)."""
    return g1_actions().to_command(_wandering(rng, runs, seconds))


def wave(rng: np.random.Generator, runs: int, seconds: float) -> np.ndarray:
    """Wander while both arms go straight from one random pose to the next: (runs, T, nc)."""
    actions, ticks = g1_actions(SIDES), round(seconds / TICK)
    knots = rng.uniform(-1.0, 1.0, (runs, round(seconds / KNOT_S) + 1, 8))
    knots[:, 0] = 0.0  # from the stance
    between = weights("linear", knots.shape[1], seconds, np.arange(ticks) * TICK)
    unit = np.concatenate([np.zeros((runs, ticks, 3)), evaluate(between, knots)], axis=-1)
    physical = actions.physical(unit)
    physical[..., :3] = _wandering(rng, runs, seconds)
    return actions.to_command(physical)


def _wandering(rng: np.random.Generator, runs: int, seconds: float) -> np.ndarray:
    ticks = round(seconds / TICK)
    drawn = rng.uniform(-1.0, 1.0, (runs, int(seconds / HOLD_S) + 1, 3)) * BASE_LIMITS
    return drawn[:, (np.arange(ticks) * TICK / HOLD_S).astype(int)]


def _pairs(commands: np.ndarray, found: np.ndarray) -> list[dict[str, list[float]]]:
    return [
        {"command": c.round(3).tolist(), "velocity": v.round(3).tolist()}
        for c, v in zip(commands, found, strict=True)
    ]


def text(options: Options, result: Mapping[str, Any]) -> str:
    """Lay out what was measured."""
    command = f"bench policy --policy {options.policy} --seed {options.seed}"
    runs = [
        (
            run["what"],
            str(run["runs"]),
            f"{run['seconds']:g}",
            str(run["falls"]),
            f"<= {run['allowed']}",
        )
        for run in result["runs"]
    ]
    followed = [
        (*(f"{c:g}" for c in pair["command"]), *(f"{v:.2f}" for v in pair["velocity"]))
        for pair in result["followed"]
    ]
    axes = ("vx", "vy", "wz")
    return "\n\n".join(
        (
            heading(command, result),
            f"G1 on an empty floor, the plant's physics, {result['engine']}. A run falls if the "
            f"pelvis sinks to {G1.fall_height:g} m.",
            markdown(("runs of", "how many", "each [s]", "falls", "target"), runs),
            "What steady commands become, means over the second half of a run, in the base's "
            "frame [m/s, rad/s]:",
            markdown((*(f"command {a}" for a in axes), *axes), followed),
        )
    )
