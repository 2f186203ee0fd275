from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.learn.recordings import Examples, gather
from sumo_dist.planner.learned import Contract, LearnedPolicy, LearnedValue

torch = pytest.importorskip("torch", reason="needs the extra train")

from sumo_dist.learn.distil import DistilConfig, distil, distil_value  # noqa: E402
from sumo_dist.learn.distil_command import Options, main  # noqa: E402

ALIKE = DistilConfig(hidden=(32,), epochs=60, sharpness=0.0)
QUICK = replace(ALIKE, sharpness=4.0)


@pytest.fixture(scope="module")
def examples(problem):
    """Ten runs of 40 plans that one of the inputs decides."""
    rng = np.random.default_rng(0)
    contract = Contract.of(problem, (0.0, 0.5), 20, {})
    size, n = sum(contract.inputs.values()), len(contract.actions)
    observations = rng.normal(size=(400, size)).astype(np.float32)
    knots = 0.5 * np.tanh(observations[:, :1, None]) * np.ones((2, n), np.float32)
    runs, costs = np.repeat(np.arange(10), 40), 50.0 + 20.0 * np.tanh(observations[:, 1])
    return Examples(observations, knots, costs, runs, contract, {"a": 10})


@pytest.fixture(scope="module")
def value(examples):
    return distil_value(examples, QUICK, 1, {})[0]


def test_a_network_learns_what_decides_plans(examples, value):
    policy, fit = distil(examples, value, ALIKE, 1, {"made": "here"})
    assert fit.error < 0.5 * fit.spread
    made = {"origin": {"made": "here"}, "trust": fit.explained}
    assert policy.contract == replace(examples.contract, **made)


def test_what_nothing_explains_is_not_trusted(examples, value):
    rng = np.random.default_rng(2)
    knots = examples.knots.copy()
    knots[:, 1] = rng.uniform(-1.0, 1.0, knots[:, 1].shape)
    policy, _ = distil(replace(examples, knots=knots), value, ALIKE, 1, {})
    trust = np.reshape(policy.contract.trust, knots.shape[1:])
    assert trust[0].min() > 0.3
    assert trust[1].max() < 0.1


def test_a_value_learns_what_decides_costs(examples, tmp_path):
    value, fit = distil_value(examples, QUICK, 1, {})
    assert fit.error < 0.5 * fit.spread
    value.save(tmp_path / "value.onnx")
    found = LearnedValue.load(tmp_path / "value.onnx")(examples.observations)
    assert np.mean((found - examples.to_come) ** 2) < 0.5 * examples.to_come.var()


def test_what_led_to_less_cost_than_expected_counts_more(examples, value):
    """Of two minds in every state, one has half the cost of the other."""
    good = np.arange(len(examples.knots)) % 2 == 0
    knots = np.where(good[:, None, None], 0.5, -0.5) * np.ones_like(examples.knots)
    costs = (np.where(good, 0.67, 1.33) * examples.to_come).astype(np.float32)
    minds = replace(examples, knots=knots.astype(np.float32), to_come=costs)
    alike, chosen = (
        distil(minds, value, config, 1, {})[0](examples.observations).mean()
        for config in (ALIKE, QUICK)
    )
    assert abs(alike) < 0.1
    assert chosen > 0.2


def test_what_is_kept_is_the_best_epoch(examples, value):
    policy, fit = distil(examples, value, QUICK, 1, {})
    shorter = [distil(examples, value, replace(QUICK, epochs=n), 1, {})[1] for n in (2, 10, 30)]
    errors = [found.error for found in (*shorter, fit)]
    assert errors == sorted(errors, reverse=True)
    again, _ = distil(examples, value, replace(QUICK, epochs=fit.epoch), 1, {})
    for ours, theirs in zip(policy.layers, again.layers, strict=True):
        np.testing.assert_array_equal(ours.weight, theirs.weight)


def test_a_single_plan_is_refused(examples):
    one = replace(
        examples,
        **{n: getattr(examples, n)[:1] for n in ("observations", "knots", "to_come", "runs")},
    )
    with pytest.raises(UsageError, match="a single plan"):
        distil_value(one, QUICK, 1, {})


def test_whole_runs_are_held_out(examples, value):
    """Labels that only the run explains cannot be learnt from other runs."""
    rng = np.random.default_rng(1)
    labels = rng.normal(size=(10, *examples.knots.shape[1:])).astype(np.float32) * 0.3
    marked = examples.observations.copy()
    marked[:, 0] = examples.runs
    marked = replace(examples, observations=marked, knots=labels[examples.runs])
    _, fit = distil(marked, value, ALIKE, 1, {})
    assert fit.error > 0.01


def test_the_command_makes_a_policy_of_recordings(recorded, tmp_path, capsys):
    out = tmp_path / "deep/proposal.onnx"
    ahead = tmp_path / "value.onnx"
    assert main(Options(runs=(recorded.parent,), out=out, value=ahead, epochs=2)) == 0
    policy, examples = LearnedPolicy.load(out), gather([recorded])
    assert policy.contract.origin["distilled"] == {"spot/move_box": 1}
    found = policy(examples.observations)
    assert found.shape == examples.knots.shape
    assert LearnedValue.load(ahead)(examples.observations).shape == examples.to_come.shape
    assert "held-out error" in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"out": "policy.pt"}, r"--out must end in \.onnx"),
        ({"value": Path("value.pt")}, r"--value must end in \.onnx"),
        ({"epochs": 0}, "from 1 to 10000"),
        ({"seed": -1}, "from 0 to"),
    ],
)
def test_refuses_options_that_cannot_be(changes, error, tmp_path):
    given = {"runs": (tmp_path,), "out": "p.onnx"} | changes
    with pytest.raises(UsageError, match=error):
        Options(**{**given, "out": tmp_path / given["out"]})
