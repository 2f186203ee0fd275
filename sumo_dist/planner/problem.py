"""A task compiled for planning: model, policy, engine and the hash that names all of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np

from sumo_dist.costs.view import ViewLayout
from sumo_dist.model.departures import LEAN
from sumo_dist.model.scene import ModelOptions, compile_model
from sumo_dist.model.variation import Variation
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.fingerprint import fingerprint
from sumo_dist.policies import Policy, load_policy
from sumo_dist.policies.hold import hold_targets
from sumo_dist.robots.compatibility import check
from sumo_dist.rollout import make_engine
from sumo_dist.rollout.interface import Engine
from sumo_dist.tasks.task import Task


@dataclass(frozen=True)
class Problem:
    """Everything a rollout worker needs to turn knots into costs.

    Attributes:
        task: the task.
        model: its planning model.
        policy: what turns commands into joint targets: the robot's low-level policy, or none.
        layout: where the task's frames lie in rollouts.
        hash: of the compiled model, the policy, and all that the task computes; its weights and
            the values of its parameters belong to a question, and are not in it.
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
        if task.controller == "joint-targets":
            policy = hold_targets(policy.contract)
        layout = ViewLayout(model, task.frames)
        return cls(task, model, policy, layout, _hash(task, model, policy))

    @property
    def hashes(self) -> dict[str, str]:
        """Hashes of what `hash` is made of, by name: they tell what of a task has changed."""
        parts, packages = _parts(self.task, self.model, self.policy)
        return {name: fingerprint(part, packages)[:16] for name, part in parts.items()}

    def engine(
        self, threads: int, kind: str = "auto", variations: Sequence[Variation] = ()
    ) -> Engine:
        """Start a rollout engine that records the task's frames; see `rollout.make_engine`."""
        refs = self.layout.refs
        return make_engine(self.model, self.policy, refs, threads, kind, variations)


def planning_options(config: PlannerConfig) -> ModelOptions:
    """Return the planning model's departures from the plant."""
    return ModelOptions(
        timestep=config.timestep,
        fluid_density=config.fluid_density,
        departures=LEAN if config.model == "lean" else (),
    )


def _hash(task: Task, model: mujoco.MjModel, policy: Policy) -> str:
    parts, packages = _parts(task, model, policy)
    return fingerprint(tuple(parts.values()), packages)[:16]


def _parts(task: Task, model: mujoco.MjModel, policy: Policy) -> tuple[dict[str, object], set[str]]:
    """Return all that a task computes, by name, and packages whose sources count."""
    compiled = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, compiled)
    terms = [(term.name, term.residual, term.reduction) for term in task.cost]
    parameters = [(parameter.name, parameter.size) for parameter in task.parameters]
    planning = terms, parameters, task.frames, task.actions, task.controller
    episode = task.reset, task.success, task.failure, task.success_hold, task.time_limit
    packages = {_package(term.residual) for term in task.cost}  # of a task that is installed
    parts = {
        "model": compiled,
        "policy": policy.contract.weights_sha256,
        "cost": planning,
        "episode": episode,
    }
    return parts, packages


def _package(function: object) -> str:
    """Top-level module of the function inside any partial applications."""
    while isinstance(function, partial):
        function = function.func
    return getattr(function, "__module__", "").partition(".")[0]
