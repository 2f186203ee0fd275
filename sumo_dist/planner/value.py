"""What comes after a plan's horizon, as a learned value says: a cost term like any other.

Workers evaluate it with the rest of the cost, so it belongs to a task, and every host that has the
task's file needs the value's as well.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from sumo_dist.costs.terms import CostTerm
from sumo_dist.costs.view import View
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.learned import LearnedValue
from sumo_dist.planner.observation import Observer
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.tasks.task import Task


def with_value(task: Task, path: Path, weight: float = 1.0) -> Task:
    """Return a task whose rollouts also cost what is to come after them.

    Args:
        task: which the value is for.
        path: of the value, from `sumo-dist distil --value`.
        weight: of the cost to come; 1 counts it like that within the horizon.

    Raises:
        PolicyError: there is no such file, or its value is for another kind of task.
    """
    value = LearnedValue.load(path)
    problem = Problem.build(task, planning_options(PlannerConfig()))
    value.contract.check(problem)
    term = CostTerm("ahead", CostToCome(value, Observer(task, problem.model)), weight)
    return replace(task, cost=(*task.cost, term))


class CostToCome:
    """A residual that is the value of a rollout's last state; its mean over the steps is that."""

    def __init__(self, value: LearnedValue, observe: Observer) -> None:
        """Hold the value and what it sees."""
        self._value, self._observe = value, observe

    def __call__(self, r: View) -> np.ndarray:
        """Return T times the value at the last of T steps, and 0 before, (B, T)."""
        rows, ticks, _ = r.states.shape
        residual = np.zeros((rows, ticks))
        residual[:, -1] = ticks * self._value(self._observe(r.states[:, -1], r.p))
        return residual
