"""A learned value as a cost term: what it adds, for whom, and that workers agree on it."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.errors import PolicyError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.learned import LearnedPolicy, LearnedValue
from sumo_dist.planner.observation import Observer
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.planner.value import with_value
from sumo_dist.policies.network import Layer
from sumo_dist.tasks import load_task

CONFIG = PlannerConfig(rollouts=6, horizon=0.4)


@pytest.fixture(scope="module")
def value(drawn_policy):
    """Costs that are drawn, from 0 to some tens."""
    contract = replace(drawn_policy("spot/move_box", seed=3).contract, times=())
    size = sum(contract.inputs.values())
    weight = np.random.default_rng(3).standard_normal((1, size)).astype(np.float32)
    return LearnedValue(contract, (Layer(weight, np.full(1, 20.0, np.float32)),))


@pytest.fixture(scope="module")
def value_file(value, tmp_path_factory):
    path = tmp_path_factory.mktemp("value") / "value.onnx"
    value.save(path)
    return path


@pytest.fixture(scope="module")
def problem(value_file):
    task = with_value(load_task("spot/move_box"), value_file, weight=2.0)
    return Problem.build(task, planning_options(CONFIG))


def test_a_rollout_costs_the_value_of_its_last_state(problem, value):
    knots = np.random.default_rng(0).uniform(-1.0, 1.0, (6, CONFIG.nodes, 9))
    parameters = problem.task.table.defaults.parameters
    start = draw_start(problem.task, 1), problem.policy.initial_memory()
    with problem.engine(1) as engine:
        evaluator = Evaluator(problem, engine, CONFIG)
        together = evaluator(*start, parameters, knots)
        alone = [evaluator(*start, parameters, row[None]) for row in knots]
        rollouts, _ = evaluator.roll_out(*start, knots)
    observe = Observer(problem.task, problem.model)
    ends = value(observe(rollouts.states[:, -1], problem.task.table.named(parameters)))
    assert np.ptp(ends) > 1.0
    np.testing.assert_allclose(together.terms[:, -1], ends, rtol=1e-12)
    for row, whole in zip(alone, together.terms, strict=True):
        assert np.array_equal(row.terms[0], whole)


def test_it_is_a_term_of_the_task(problem):
    term = problem.task.cost[-1]
    assert (term.name, term.weight) == ("ahead", 2.0)
    assert problem.task.name == "spot/move_box"


def test_the_task_of_the_guide_has_a_value(value, tmp_path, monkeypatch):
    guide = Path(__file__).parents[2].joinpath("docs/guides/learning.md").read_text("utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", guide, flags=re.DOTALL)
    (tmp_path / "move_box_ahead.py").write_text(code)
    (tmp_path / "runs").mkdir()
    value.save(tmp_path / "runs/value.onnx")
    monkeypatch.chdir(tmp_path)
    assert [term.name for term in load_task("move_box_ahead.py").cost][-1] == "ahead"


def test_another_value_is_another_problem(problem, value, tmp_path):
    (layer,) = value.layers
    other = replace(value, layers=(layer._replace(weight=2.0 * layer.weight),))
    other.save(tmp_path / "other.onnx")
    options = planning_options(CONFIG)
    task = with_value(load_task("spot/move_box"), tmp_path / "other.onnx", weight=2.0)
    assert Problem.build(task, options).hash != problem.hash
    value.save(tmp_path / "same.onnx")
    task = with_value(load_task("spot/move_box"), tmp_path / "same.onnx", weight=2.0)
    assert Problem.build(task, options).hash == problem.hash


def test_what_is_no_value_of_the_task_is_refused(value_file, policy_file, tmp_path):
    with pytest.raises(PolicyError, match="cannot do task 'g1/box_push'"):
        with_value(load_task("g1/box_push"), value_file)
    with pytest.raises(PolicyError, match="holds no value of states"):
        with_value(load_task("spot/move_box"), policy_file)
    with pytest.raises(PolicyError, match="holds no policy"):
        LearnedPolicy.load(value_file)
    with pytest.raises(PolicyError, match="cannot read"):
        with_value(load_task("spot/move_box"), tmp_path / "none.onnx")
