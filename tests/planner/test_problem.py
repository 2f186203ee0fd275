from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import norm
from sumo_dist.model.scene import PLANNING, ModelOptions
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.robots.joint_actions import joint_actions
from sumo_dist.robots.spot import SPOT


def build(problem, options=PLANNING, **changes):
    return Problem.build(replace(problem.task, **changes), options)


def test_the_planning_model_has_the_settings_of_the_config():
    options = planning_options(PlannerConfig(timestep=0.01, fluid_density=1.2, model="full"))
    assert options == ModelOptions(timestep=0.01, fluid_density=1.2)
    assert planning_options(PlannerConfig()) == PLANNING


def test_the_same_task_has_the_same_hash(problem):
    assert build(problem).hash == problem.hash


def test_the_hash_names_the_model(problem):
    assert build(problem, ModelOptions(0.01, 0.0)).hash != problem.hash
    slippery = replace(problem.task.scene, floor_friction=0.3)
    assert build(problem, scene=slippery).hash != problem.hash


def test_numbers_that_a_question_brings_are_not_in_the_hash(problem):
    """Weights, defaults, ranges: workers that know the task need not compile it again for them."""
    first, *others = problem.task.cost
    goal, *rest = problem.task.parameters
    cost = (replace(first, weight=61.0), *others)
    parameters = (replace(goal, default=(1.0, 2.0), range=(-3.0, 3.0)), *rest)
    assert build(problem, cost=cost, parameters=parameters).hash == problem.hash


def test_the_hash_names_the_parameters_and_their_sizes(problem):
    goal, *rest = problem.task.parameters
    swapped = (*rest, goal)
    more = (goal, *rest, Parameter("slope", 0.0))
    assert build(problem, parameters=swapped).hash != problem.hash
    assert build(problem, parameters=more).hash != problem.hash
    pair = replace(problem.task, parameters=(*more[:-1], Parameter("slope", (0.0, 0.0))))
    hashes = {build(problem, parameters=p).hash for p in (more, pair.parameters)}
    assert len(hashes) == 2


def test_the_hash_names_the_controller(problem):
    assert build(problem, controller="joint-targets").hash != problem.hash


@pytest.mark.parametrize("change", [{"reduction": "squared_mean"}, {"name": "g"}])
def test_the_hash_names_the_cost_table(problem, change):
    first, *others = problem.task.cost
    cost = (replace(first, **change), *others)
    assert build(problem, cost=cost).hash != problem.hash


def test_the_hash_names_the_source_of_the_cost(problem):
    first, *others = problem.task.cost

    def from_another_file(r):
        return norm(r.object.pos)

    cost = (replace(first, residual=from_another_file), *others)
    assert build(problem, cost=cost).hash != problem.hash


def test_an_engine_records_the_tasks_frames(problem, engine, start):
    state, memory = start
    command = np.tile(SPOT.default_command, (1, 2, 1))
    rollouts = engine.rollout(state, memory, command)
    assert rollouts.positions.shape == (1, 2, len(problem.task.frames), 3)
    box = problem.layout.names.index("object")
    assert rollouts.positions[0, -1, box] == pytest.approx(state[26:29], abs=0.01)


def test_joint_targets_are_planned_for_like_commands(problem, config, start):
    """The arm's three big joints, without any policy: what is planned is what the servos hold."""
    arm = ("arm_sh0", "arm_sh1", "arm_el0")
    held = build(problem, controller="joint-targets", actions=joint_actions(SPOT, arm))
    state, memory = start[0], held.policy.initial_memory()
    assert held.policy.contract.name == "joint-targets"
    knots = np.random.default_rng(0).uniform(-1, 1, (3, config.nodes, 3)).astype(np.float32)
    with held.engine(threads=1) as engine:
        evaluator = Evaluator(held, engine, config)
        evaluation = evaluator(state, memory, held.task.table.defaults.parameters, knots)
        rollouts, physical = evaluator.roll_out(state, memory, knots)
    assert evaluation.valid.all()
    assert np.isfinite(evaluation.costs(held.task.table.defaults.weights)).all()
    joints = [SPOT.joints.index(name) for name in arm]
    assert np.array_equal(rollouts.targets[:, :, joints], physical)
    legs = [i for i in range(len(SPOT.joints)) if i not in joints]
    assert np.array_equal(rollouts.targets[0, 7, legs], np.array(SPOT.stand)[legs])
    reached = rollouts.states[:, -1, 7 + np.array(joints)]
    assert np.ptp(reached, axis=0).min() > 0.05  # the arm goes where it is told, each its own way
