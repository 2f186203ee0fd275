"""The file of a learned policy: what is written comes back, and what is foreign is refused."""

import shutil
from dataclasses import replace

import numpy as np
import onnx
import pytest

from sumo_dist.errors import PolicyError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.learned import KEY, Contract, LearnedPolicy, driving
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.policies.fetch import cached
from sumo_dist.policies.manifest import pinned_policy
from sumo_dist.tasks import load_task
from sumo_dist.timing import anchor_tick


@pytest.fixture(scope="module")
def policy(drawn_policy):
    return drawn_policy("spot/move_box", seed=2, times=(0.0, 0.5), command="drawn")


@pytest.fixture
def rows(policy):
    size = sum(policy.contract.inputs.values())
    return np.random.default_rng(0).standard_normal((6, size)).astype(np.float32)


def test_what_is_saved_is_read_to_the_last_bit(policy, rows, tmp_path):
    path = tmp_path / "policy.onnx"
    policy.save(path)
    again = LearnedPolicy.load(path)
    assert again.contract == policy.contract
    assert again.contract.origin == {"seed": 2, "command": "drawn"}
    for ours, theirs in zip(again.layers, policy.layers, strict=True):
        assert ours.activation == theirs.activation
        assert np.array_equal(ours.weight, theirs.weight)
        assert np.array_equal(ours.bias, theirs.bias)
    assert np.array_equal(again(rows), policy(rows))
    assert [found.name for found in tmp_path.iterdir()] == ["policy.onnx"]


def test_knots_are_normalised_and_a_row_has_the_same_bits_alone(policy, rows):
    together = policy(rows * 100.0)
    assert together.shape == (6, 2, len(policy.contract.actions))
    assert np.abs(together).max() <= 1.0
    for row, knots in zip(rows, policy(rows), strict=True):
        assert np.array_equal(policy(row[None])[0], knots)


@pytest.mark.parametrize(
    ("task", "changes", "message"),
    [
        ("g1/box_push", {}, "whose robot is spot cannot do task 'g1/box_push': there it is g1"),
        ("spot/move_box", {"low_level": "abc"}, "whose low level is abc cannot do task"),
        ("spot/move_box", {"inputs": {"base": 3}}, "whose inputs is {'base': 3} cannot do task"),
        ("spot/move_box", {"actions": ("arm",)}, r"whose actions is \('arm',\) cannot do task"),
        ("spot/move_box", {"upper": (3.0,)}, r"whose upper is \(3.0,\) cannot do task"),
    ],
)
def test_a_policy_is_refused_where_its_contract_differs(policy, task, changes, message):
    problem = Problem.build(load_task(task), planning_options(PlannerConfig()))
    with pytest.raises(PolicyError, match=message):
        replace(policy.contract, **changes).check(problem)


@pytest.mark.parametrize("task", ["spot/move_box", "spot/move_tire", "spot/upright_cone"])
def test_other_objects_and_goals_fit_its_contract(policy, task):
    problem = Problem.build(load_task(task), planning_options(PlannerConfig()))
    policy.contract.check(problem)


def _text(path, policy):
    path.write_text("weights\n")


def _empty(path, policy):
    path.touch()


def _cut(path, policy):
    policy.save(path)
    path.write_bytes(path.read_bytes()[:-200])


def _low_level(path, policy):
    shutil.copy(cached(pinned_policy("spot")), path)


def _folder(path, policy):
    path.mkdir()


def _of_another_version(path, policy):
    policy.save(path)
    model = onnx.load_model(path)
    onnx.helper.set_model_props(model, {KEY: '{"robot": "spot"}'})
    onnx.save_model(model, path)


def _of_another_size(path, policy):
    outputs = replace(policy.contract, times=(0.0,))
    replace(policy, contract=outputs).save(path)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path, policy: None, "cannot read policy file .*: No such file or directory"),
        (_folder, "cannot read policy file .*: Is a directory"),
        (_text, "not an ONNX file"),
        (_empty, "not made by `sumo-dist train` or `sumo-dist distil`"),
        (_cut, "not an ONNX file|it has no contract"),
        (_low_level, "not made by `sumo-dist train` or `sumo-dist distil`"),
        (_of_another_version, "its contract is of another version: needs "),
        (_of_another_size, "the network has .* outputs, .* are valid"),
    ],
)
def test_foreign_files_are_refused(policy, tmp_path, make, message):
    path = tmp_path / "policy.onnx"
    make(path, policy)
    with pytest.raises(PolicyError, match=message) as refused:
        LearnedPolicy.load(path)
    assert "policy.onnx" in str(refused.value) and "\n" not in str(refused.value)


def test_a_contract_survives_its_text(policy):
    assert Contract.from_json(policy.contract.to_json()) == policy.contract


def test_settings_by_which_a_policy_drives_alone(policy_file):
    config = PlannerConfig().changed(driving(policy_file))
    assert config.populations == (1,)
    assert (config.guidance, config.policy, config.guided) == ("learned", str(policy_file), 1.0)
    assert (config.rate, config.horizon) == (20, 0.06)
    with pytest.raises(PolicyError, match="No such file"):
        driving(policy_file.with_name("none.onnx"))


@pytest.mark.parametrize("rate", [1, 7, 10, 20, 49, 50])
def test_a_policy_that_drives_holds_its_action_until_the_next_plan(drawn_policy, tmp_path, rate):
    path = tmp_path / "policy.onnx"
    drawn_policy("spot/move_box", seed=1, rate=rate).save(path)
    config = PlannerConfig().changed(driving(path))
    ticks = [anchor_tick(number, config.rate) for number in range(rate + 1)]
    assert config.rate == rate
    assert config.steps >= np.diff(ticks).max()
