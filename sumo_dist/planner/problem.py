"""A task compiled for planning: model, policy, engine and the hash that names all of it."""

import hashlib
import inspect
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from sumo_dist.costs.view import ViewLayout
from sumo_dist.model.scene import ModelOptions, compile_model
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.policies import Policy, load_policy
from sumo_dist.policies.contract import check
from sumo_dist.rollout import make_engine
from sumo_dist.rollout.interface import Engine
from sumo_dist.tasks.task import Task


@dataclass(frozen=True)
class Problem:
    """Everything a rollout worker needs to turn knots into costs.

    Attributes:
        task: the task.
        model: its planning model.
        policy: the robot's low-level policy.
        layout: where the task's frames lie in rollouts.
        hash: of the compiled model, the cost's source and weights, and the policy.
    """

    task: Task
    model: mujoco.MjModel
    policy: Policy
    layout: ViewLayout
    hash: str

    @classmethod
    def build(cls, task: Task, options: ModelOptions) -> "Problem":
        """Compile the planning model, load the policy (fetching it on first need), check both."""
        model = compile_model(task.scene, options)
        policy = load_policy(task.scene.robot.policy)
        check(policy.contract, task.scene.robot, model)
        layout = ViewLayout(model, task.frames)
        return cls(task, model, policy, layout, _hash(task, model, policy))

    def engine(self, threads: int, kind: str = "auto") -> Engine:
        """Start a rollout engine that records the task's frames."""
        return make_engine(self.model, self.policy, self.layout.refs, threads, kind)


def planning_options(config: PlannerConfig) -> ModelOptions:
    """Return the planning model's departures from the plant."""
    return ModelOptions(timestep=config.timestep, fluid_density=config.fluid_density)


def _hash(task: Task, model: mujoco.MjModel, policy: Policy) -> str:
    digest = hashlib.sha256()
    compiled = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, compiled)
    digest.update(compiled.tobytes())
    digest.update(policy.contract.weights_sha256.encode())
    sources = set()
    for term in task.cost:
        digest.update(f"{term.name} {term.weight!r} {term.reduction}".encode())
        function = term.function.func if isinstance(term.function, partial) else term.function
        sources.add(inspect.getsourcefile(function) or "")
    for source in sorted(filter(None, sources), key=lambda s: Path(s).name):
        digest.update(Path(source).read_bytes())
    return digest.hexdigest()[:16]
