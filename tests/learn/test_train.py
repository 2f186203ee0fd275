import subprocess
import sys
import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from sumo_dist.errors import PolicyError, UsageError
from sumo_dist.learn.command import Options
from sumo_dist.learn.environment import EnvironmentConfig
from sumo_dist.learn.ppo_config import PPOConfig
from sumo_dist.model.variation import Spread
from sumo_dist.planner.learned import LearnedPolicy
from sumo_dist.tasks import load_task

torch = pytest.importorskip("torch", reason="needs the extra train")

from sumo_dist.learn.train import Request, Training, state_hash  # noqa: E402

REQUEST = Request(
    "spot/move_box",
    seed=3,
    environment=EnvironmentConfig(
        count=8, starts=4, models=2, spread=Spread(mass=0.5), time_limit=0.5
    ),
    ppo=PPOConfig(hidden=(16,), steps=4, epochs=2, batches=2),
    weight=("fall=250",),
)


def train(folder, updates, threads=1, request=REQUEST, start=None):
    accounts = []
    with Training(folder, request, threads, start) as training:
        training.run(updates, lambda number, account: accounts.append((number, account)))
        return training.policy, accounts


def assert_equal_bits(one, other):
    for ours, theirs in zip(one.layers, other.layers, strict=True):
        np.testing.assert_array_equal(ours.weight, theirs.weight)
        np.testing.assert_array_equal(ours.bias, theirs.bias)


def test_a_seed_trains_the_same_weights_on_any_number_of_threads_and_another_seed_others(tmp_path):
    one, accounts = train(tmp_path / "one", 4)
    two, _ = train(tmp_path / "two", 4, threads=2)
    assert_equal_bits(one, two)
    assert [number for number, _ in accounts] == [1, 2, 3, 4]
    other, _ = train(tmp_path / "other", 4, request=replace(REQUEST, seed=4))
    assert not np.array_equal(one.layers[0].weight, other.layers[0].weight)


@pytest.mark.parametrize("kl", [0.0, 0.01])
def test_a_training_goes_on_as_if_nothing_had_been_between(tmp_path, kl):
    request = replace(REQUEST, ppo=replace(REQUEST.ppo, kl=kl))
    whole, accounts = train(tmp_path / "whole", 5, request=request)
    train(tmp_path / "parts", 2, request=request)
    resumed, later = train(tmp_path / "parts", 5, request=request)
    assert_equal_bits(whole, resumed)
    assert later == accounts[2:]
    rows = (tmp_path / "parts/progress.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["update", *"12345"]


def test_the_first_noise_is_less_where_it_is_asked_for():
    """An arm's noise at the gripper hides what legs do to its distance."""
    actions = load_task("spot/joints_move_box").actions
    usual = PPOConfig().deviations(actions)
    calm = PPOConfig(noise=("arm=0.1", "arm_sh0=0.5")).deviations(actions)
    is_arm = np.char.startswith(np.array(actions.names), "arm")
    assert is_arm.sum() == 6
    expected = np.where(is_arm, 0.1, 1.0)
    expected[actions.names.index("arm_sh0")] = 0.05
    np.testing.assert_allclose(calm / usual, expected)
    wide = PPOConfig().deviations(load_task("spot/move_box").actions)
    np.testing.assert_array_equal(wide, [0.7] * 3 + [0.3] * 6)


def test_the_first_actions_are_a_stance_of_ones_own_if_one_is_named(tmp_path):
    space = load_task("spot/move_box").actions
    ppo = replace(REQUEST.ppo, stand=("arm_sh1=-1.5", "arm_wr0=-0.5"))
    lowered = ppo.standing(space)
    physical = space.physical(lowered)
    assert (physical[space.names.index("arm_sh1")], physical[-2]) == pytest.approx((-1.5, -0.5))
    usual = REQUEST.ppo.standing(space)
    assert np.flatnonzero(lowered != usual).tolist() == [4, 7]
    policies = [
        train(tmp_path / str(i), 0, request=replace(REQUEST, ppo=each))[0]
        for i, each in enumerate((REQUEST.ppo, ppo))
    ]
    biases = [policy.layers[-1].bias for policy in policies]
    np.testing.assert_allclose(biases[1] - biases[0], lowered - usual, atol=1e-6)


def test_the_policy_that_is_written_is_the_learners(tmp_path):
    policy, _ = train(tmp_path / "run", 2)
    read = LearnedPolicy.load(tmp_path / "run/policy.onnx")
    assert_equal_bits(policy, read)
    assert read.contract == policy.contract
    assert read.contract.origin["actions"] == 2 * 8 * 4
    assert read.contract.origin["trained"]["weight"] == ["fall=250"]


def test_a_training_begins_with_the_policy_of_another_and_with_the_noise_it_is_given(tmp_path):
    first, _ = train(tmp_path / "first", 3)
    noise = ("base=0.5", "arm=2")  # by which the network's outputs are scaled, too
    request = replace(
        REQUEST,
        ppo=replace(REQUEST.ppo, noise=noise),
        weight=(*REQUEST.weight, "goal=90"),
        start=state_hash(tmp_path / "first"),
    )
    begin = partial(train, request=request, start=tmp_path / "first")
    begun, _ = begin(tmp_path / "second", 0)
    for ours, theirs in zip(begun.layers, first.layers, strict=True):
        np.testing.assert_allclose(ours.weight, theirs.weight, rtol=1e-5)
        np.testing.assert_allclose(ours.bias, theirs.bias, rtol=1e-5)
    whole, accounts = begin(tmp_path / "second", 2)
    assert accounts[0][1].deviation == pytest.approx(1.0, abs=0.05)
    # It goes on as any training does, and another one would not.
    begin(tmp_path / "parts", 1)
    resumed, _ = begin(tmp_path / "parts", 2)
    assert_equal_bits(whole, resumed)
    other, _ = train(tmp_path / "other", 2, request=replace(request, start=""))
    assert not np.array_equal(whole.layers[0].weight, other.layers[0].weight)
    # What a policy has taken is told of both.
    origin = whole.contract.origin
    assert (origin["updates"], origin["actions"]) == (5, 5 * 8 * 4)
    assert origin["began_with"] == first.contract.origin


def test_what_is_no_training_to_begin_with_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"no training to begin with: it has no training\.pt"):
        state_hash(tmp_path)
    train(tmp_path / "box", 1)
    joints = replace(REQUEST, task="spot/joints_move_box", start=state_hash(tmp_path / "box"))
    with pytest.raises(PolicyError, match="a learned policy whose low level is"):
        train(tmp_path / "joints", 1, request=joints, start=tmp_path / "box")
    wide = replace(REQUEST, ppo=replace(REQUEST.ppo, hidden=(32,)), seed=4)
    with pytest.raises(
        UsageError, match=r"have hidden layers of \(16,\), this training's of \(32,"
    ):
        train(tmp_path / "wide", 1, request=wide, start=tmp_path / "box")
    assert not (tmp_path / "joints").exists()
    assert not (tmp_path / "wide").exists()


@pytest.mark.parametrize("damage", ["cut", "changed", "empty", "text", "another"])
def test_a_state_that_is_damaged_is_refused(tmp_path, damage):
    train(tmp_path / "box", 1)
    file = tmp_path / "box" / "training.pt"
    data = bytearray(file.read_bytes())
    if damage == "changed":
        data[len(data) // 2] ^= 1
    whole = {"cut": data[: len(data) // 2], "changed": data, "empty": b"", "text": b"weights\n"}
    if damage == "another":
        torch.save({"weights": torch.zeros(3)}, file)
    else:
        file.write_bytes(whole[damage])
    refusal = pytest.raises(UsageError, match=r"training\.pt is damaged or unreadable: restore it")
    with refusal:
        train(tmp_path / "box", 2)
    with refusal:
        train(tmp_path / "second", 2, request=replace(REQUEST, seed=4), start=tmp_path / "box")
    assert not (tmp_path / "second").exists()


def test_a_folder_keeps_its_training(tmp_path):
    train(tmp_path, 1)
    with pytest.raises(UsageError, match="holds another training"):
        Training(tmp_path, replace(REQUEST, seed=9), 1)
    with pytest.raises(UsageError, match="holds something else than a training"):
        (tmp_path / "mine").mkdir()
        (tmp_path / "mine/thesis.txt").write_text("all my work")
        Training(tmp_path / "mine", REQUEST, 1)


@pytest.mark.slow
def test_a_training_that_is_killed_goes_on_to_the_same_weights(tmp_path):
    options = Options(
        task="spot/move_box", out=tmp_path / "killed", updates=13, envs=4, seed=5, threads=1
    )
    whole, _ = train(tmp_path / "whole", 13, request=options.request)
    command = [sys.executable, "-m", "sumo_dist", "train", options.task, "--updates", "13"]
    command += ["--envs", "4", "--threads", "1", "--seed", "5", "--out", str(options.out)]
    killed = subprocess.Popen(command)
    progress = options.out / "progress.csv"
    began = time.monotonic()
    while not (progress.exists() and len(progress.read_text().splitlines()) > 11):
        assert time.monotonic() - began < 120
        assert killed.poll() is None, "it ended before it was killed"
        time.sleep(0.002)
    killed.kill()
    killed.wait()
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=150)
    assert "has 10 updates; it goes on" in done.stdout + done.stderr
    assert_equal_bits(whole, LearnedPolicy.load(options.out / "policy.onnx"))
