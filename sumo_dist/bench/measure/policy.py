"""`sumo-dist bench policy`: does G1's policy stay on its feet."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sumo_dist.bench.layout import Result, check_at_least, checked_engine, run_bench, table
from sumo_dist.errors import unknown
from sumo_dist.math.splines import evaluate, weights
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.model.settle import settled_stand
from sumo_dist.policies import load_policy
from sumo_dist.provenance import cores
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
STEADY = np.array(
    [
        *((0.0, 0.0, 0.0), (_X / 2, 0.0, 0.0), (_X, 0.0, 0.0), (-_X, 0.0, 0.0)),
        *((0.0, _Y, 0.0), (0.0, -_Y, 0.0), (0.0, 0.0, _W), (0.0, 0.0, -_W)),
        *((_X, _Y, _W), (-_X, -_Y, -_W), (_X, 0.0, -_W), (_X / 2, -_Y, _W / 2)),
    ]
)
RUNS = {
    "runs of": "{what}",
    "how many": "{runs}",
    "each [s]": "{seconds:g}",
    "falls": "{falls}",
    "target": "<= {allowed}",
}


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

    def __post_init__(self) -> None:
        check_at_least(0, seed=self.seed)
        if self.policy not in POLICIES:
            raise unknown("policy", self.policy, POLICIES)


def main(options: Options) -> int:
    """Walk, and print tables or one JSON object; 1 if the policy fell too often."""
    command = f"bench policy --policy {options.policy} --seed {options.seed}"
    result = run_bench(command, options.json, partial(measure, options), text)
    return 0 if all(run["falls"] <= run["allowed"] for run in result["runs"]) else 1


class Walker:
    """Walks G1 over an empty floor with the plant's physics, many runs at once."""

    def __init__(self, policy: str, kind: str) -> None:
        """Load the policy and see that it fits."""
        self._robot, self._kind = replace(G1, policy=policy), kind
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


def measure(options: Options) -> Result:
    """Count the falls of every kind of run."""
    engine, _ = checked_engine(options.engine)
    walker, rng = Walker(options.policy, options.engine), np.random.default_rng(options.seed)
    kinds = (
        ("steady commands", steady(STEADY, LONG_S), LONG_S, 0),
        ("random commands", wander(rng, RANDOM_RUNS, LONG_S), LONG_S, 0),
        ("random commands, both arms moved by up to 1 rad", wave(rng, ARM_RUNS, ARMS_S), ARMS_S, 1),
    )
    runs = [
        {
            "what": what,
            "runs": len(commands),
            "seconds": seconds,
            "falls": walker.falls(walker.walk(commands)),
            "allowed": allowed,
        }
        for what, commands, seconds, allowed in kinds
    ]
    return {"engine": engine, "policy": options.policy, "seed": options.seed, "runs": runs}


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


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    yield (
        f"G1 on an empty floor, the plant's physics, {result['engine']}. A run falls if the "
        f"pelvis sinks to {G1.fall_height:g} m."
    )
    yield table(RUNS, result["runs"])


def _wandering(rng: np.random.Generator, runs: int, seconds: float) -> np.ndarray:
    """Random velocities of the base (runs, T, 3)."""
    ticks = round(seconds / TICK)
    drawn = rng.uniform(-1.0, 1.0, (runs, int(seconds / HOLD_S) + 1, 3)) * BASE_LIMITS
    return drawn[:, (np.arange(ticks) * TICK / HOLD_S).astype(int)]
