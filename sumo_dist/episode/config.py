"""What decides an episode, and how it is written into its recording."""

from dataclasses import asdict, dataclass, field
from typing import Any

from sumo_dist.errors import UsageError, unknown
from sumo_dist.estimate import ESTIMATORS
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem
from sumo_dist.plant.noise import plant_profile
from sumo_dist.provenance import versions
from sumo_dist.tasks import task_source

CLOCKS = ("lockstep", "realtime")


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
    """

    task: str
    seed: int = 0
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    clock: str = "lockstep"
    estimator: str = "truth"
    time_limit: float | None = None
    engine: str = "auto"
    plant: str = "nominal"

    def __post_init__(self) -> None:
        object.__setattr__(self, "task", task_source(self.task))
        if self.clock not in CLOCKS:
            raise unknown("clock", self.clock, CLOCKS)
        if self.estimator not in ESTIMATORS:
            raise unknown("estimator", self.estimator, ESTIMATORS)
        plant_profile(self.plant)
        if not 0 <= self.seed < 2**63:
            raise UsageError(f"seed must be a whole number from 0 to 2^63 - 1, got {self.seed}")
        if self.time_limit is not None and not 0 < self.time_limit <= 3600:
            raise UsageError(f"time limit must be in (0, 3600] s, got {self.time_limit}")

    def describe(self, problem: Problem, engine: str) -> dict[str, Any]:
        """Return the resolved config for the recording; `engine` names the one in use."""
        return {
            "task": self.task,
            "task_name": problem.task.name,
            "robot": problem.task.scene.robot.name,
            "optimizer": self.planner.optimizer,
            "engine": engine,
            "clock": self.clock,
            "estimator": self.estimator,
            "plant": self.plant,
            "plant_profile": asdict(plant_profile(self.plant)),
            "seed": self.seed,
            "planner": asdict(self.planner),
            "task_hash": problem.hash,
            "config_hash": self.planner.hash(problem.hash),
            "terms": [term.name for term in problem.task.cost],
            "versions": versions(),
        }
