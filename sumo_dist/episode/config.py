"""What decides an episode, and how it travels: in recordings, over the bus, to other processes."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Self

from sumo_dist.costs.table import CostSettings
from sumo_dist.errors import UsageError, text_of, unknown
from sumo_dist.estimate import ESTIMATORS
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem
from sumo_dist.plant.noise import plant_profile
from sumo_dist.provenance import versions
from sumo_dist.record.world import description
from sumo_dist.tasks import task_source
from sumo_dist.tasks.task import Task

CLOCKS = ("lockstep", "realtime")
# Of fields as they come from elsewhere; all others are texts.
_KINDS = {
    "planner": Mapping,
    "seed": int,
    "time_limit": float | int | None,
    "weight": list | tuple,
    "param": list | tuple,
}


@dataclass(frozen=True)
class EpisodeConfig:
    """One episode of one task.

    Attributes:
        task: its name, or the path of its file, which is made absolute.
        seed: decides the start and all noise.
        planner: the planner's settings.
        clock: "lockstep" or "realtime".
        estimator: "truth" or "lowpass".
        time_limit: robot time [s]; None takes the task's.
        engine: kind of rollout engine, see rollout.make_engine.
        plant: "nominal", "perturbed" or "hard", see plant.noise.
        weight: weights of cost terms in place of the task's, such as "goal=80".
        param: parameters in place of the task's, such as "goal=1,0".
    """

    task: str
    seed: int = 0
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    clock: str = "lockstep"
    estimator: str = "truth"
    time_limit: float | None = None
    engine: str = "auto"
    plant: str = "nominal"
    weight: tuple[str, ...] = ()
    param: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "task", text_of(task_source(self.task)))
        if self.clock not in CLOCKS:
            raise unknown("clock", self.clock, CLOCKS)
        if self.estimator not in ESTIMATORS:
            raise unknown("estimator", self.estimator, ESTIMATORS)
        plant_profile(self.plant)
        if not 0 <= self.seed < 2**63:
            raise UsageError(f"seed must be a whole number from 0 to 2^63 - 1, got {self.seed}")
        if self.time_limit is not None and not 0 < self.time_limit <= 3600:
            raise UsageError(f"time limit must be in (0, 3600] s, got {self.time_limit}")

    def cost(self, task: Task) -> CostSettings:
        """Weights and parameters at the start of an episode of the task, checked."""
        return task.table.adjusted(self.weight, self.param)

    def to_json(self) -> str:
        """Return all that `from_json` needs to build the same episode."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Build the episode that `to_json` was asked of; raise UsageError for anything else."""
        try:
            return cls.of(json.loads(text))
        except (ValueError, RecursionError) as error:
            raise UsageError(f"this is no episode's configuration: {error}") from None

    @classmethod
    def of(cls, record: Any) -> Self:
        """Build an episode from its fields by name, as a recording has them."""
        names = {f.name for f in fields(cls)}
        if not isinstance(record, Mapping) or set(record) != names:
            found = sorted(map(str, record)) if isinstance(record, Mapping) else record
            raise UsageError(f"an episode of another version: needs {sorted(names)}, got {found}")
        given = dict(record)
        wrong = [n for n, value in given.items() if not isinstance(value, _KINDS.get(n, str))]
        if not wrong:
            given["weight"], given["param"] = tuple(given["weight"]), tuple(given["param"])
            texts = *given["weight"], *given["param"]
            wrong = [] if all(isinstance(text, str) for text in texts) else ["weight or param"]
        if wrong:
            raise UsageError(f"an episode's field has a wrong type: {', '.join(wrong)}")
        given["planner"] = PlannerConfig.from_settings(given["planner"])
        return cls(**given)

    def describe(self, problem: Problem, engine: tuple[str, str]) -> dict[str, Any]:
        """Return the resolved config for the recording, with the engine's name and build."""
        table = problem.task.table
        return {
            "episode": asdict(self),
            "task_name": problem.task.name,
            "task": description(problem.task),
            "robot": problem.task.scene.robot.name,
            "engine": engine[0],
            "engine_build": engine[1],
            "plant_profile": asdict(plant_profile(self.plant)),
            "task_hash": problem.hash,
            "hashes": problem.hashes,
            "config_hash": self.planner.hash(problem.hash),
            "terms": list(table.terms),
            "parameters": {name: p.default for name, p in table.parameters.items()},
            "versions": versions(),
        }
