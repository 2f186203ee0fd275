from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.costs.terms import norm
from sumo_dist.model.scene import PLANNING, ModelOptions
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.robots.spot import SPOT


def build(problem, options=PLANNING, **changes):
    return Problem.build(replace(problem.task, **changes), options)


def test_the_planning_model_has_the_settings_of_the_config():
    options = planning_options(PlannerConfig(timestep=0.01, fluid_density=1.2))
    assert options == ModelOptions(timestep=0.01, fluid_density=1.2)
    assert planning_options(PlannerConfig()) == PLANNING


def test_the_same_task_has_the_same_hash(problem):
    assert build(problem).hash == problem.hash


def test_the_hash_names_the_model(problem):
    assert build(problem, ModelOptions(0.01, 0.0)).hash != problem.hash
    slippery = replace(problem.task.scene, floor_friction=0.3)
    assert build(problem, scene=slippery).hash != problem.hash


@pytest.mark.parametrize("change", [{"weight": 61.0}, {"reduction": "squared_mean"}, {"name": "g"}])
def test_the_hash_names_the_cost_table(problem, change):
    first, *others = problem.task.cost
    cost = (replace(first, **change), *others)
    assert build(problem, cost=cost).hash != problem.hash


def test_the_hash_names_the_source_of_the_cost(problem):
    first, *others = problem.task.cost

    def from_another_file(r):
        return norm(r.object.pos)

    cost = (replace(first, function=from_another_file), *others)
    assert build(problem, cost=cost).hash != problem.hash


def test_an_engine_records_the_tasks_frames(problem, engine, start):
    state, memory = start
    command = np.tile(SPOT.default_command, (1, 2, 1))
    rollouts = engine.rollout(state, memory, command)
    assert rollouts.positions.shape == (1, 2, len(problem.task.frames), 3)
    box = problem.layout.names.index("object")
    assert rollouts.positions[0, -1, box] == pytest.approx(state[26:29], abs=0.01)
