import json
from dataclasses import asdict, fields, replace

import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem, planning_options


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"clock": "wall"}, "unknown clock 'wall'; valid: lockstep, realtime"),
        ({"estimator": "kalman"}, "unknown estimator 'kalman'; valid: lowpass, truth"),
        ({"seed": -1}, "seed must be a whole number from 0"),
        ({"seed": 2**63}, "seed must be a whole number from 0"),
        ({"time_limit": 0.0}, r"time limit must be in \(0, 3600\] s, got 0.0"),
        ({"time_limit": float("nan")}, r"time limit must be in \(0, 3600\] s"),
        ({"time_limit": 1e9}, r"time limit must be in \(0, 3600\] s"),
    ],
)
def test_bad_values_say_what_is_valid(change, message):
    with pytest.raises(UsageError, match=message):
        EpisodeConfig("spot/move_box", **change)


def test_the_description_names_all_that_decides_a_run(move_box):
    planner = PlannerConfig("mppi", rollouts=5)
    config = EpisodeConfig(
        "spot/move_box", seed=2**62, planner=planner, plant="hard", weight=("goal=80",)
    )
    problem = Problem.build(move_box, planning_options(planner))
    described = config.describe(problem, ("native-avx2", "a-build"))
    assert (described["task_name"], described["robot"]) == ("spot/move_box", "spot")
    assert EpisodeConfig.of(json.loads(json.dumps(described["episode"]))) == config
    assert described["engine"] == "native-avx2"
    assert described["plant_profile"]["mocap_gap_ms"] == 50
    assert described["parameters"]["goal"] == (0.0, 0.0)
    assert list(described["parameters"]) == ["goal", "success_radius", "success_speed"]
    assert described["terms"] == ["goal", "gripper", "velocity", "fall"]
    assert described["task_hash"] == problem.hash
    assert described["config_hash"] == planner.hash(problem.hash)
    assert {"sumo-dist", "mujoco", "numpy", "python"} <= set(described["versions"])


FULL = EpisodeConfig(
    "spot/move_box",
    seed=2**63 - 1,
    planner=PlannerConfig("icem", rollouts=7, horizon=0.4, iterations=2, noise_exponent=1.5),
    clock="realtime",
    estimator="lowpass",
    time_limit=2.5,
    engine="fallback",
    plant="perturbed",
    weight=("goal=80", "velocity=0.1"),
    param=("goal=1,-0.5",),
)


def test_every_field_survives_as_json():
    usual = EpisodeConfig("spot/move_box")
    differing = {f.name for f in fields(usual) if getattr(usual, f.name) != getattr(FULL, f.name)}
    assert differing == {f.name for f in fields(usual)} - {"task"}
    assert EpisodeConfig.from_json(FULL.to_json()) == FULL
    assert EpisodeConfig.from_json(usual.to_json()) == usual
    assert EpisodeConfig.from_json(usual.to_json()).time_limit is None


def test_a_file_means_the_same_elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = EpisodeConfig("mine.py").to_json()
    monkeypatch.chdir("/")
    assert EpisodeConfig.from_json(text).task == str(tmp_path / "mine.py")


def changed(**changes):
    return json.dumps({**asdict(FULL), **changes})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "this is no episode's configuration"),
        ("{", "this is no episode's configuration"),
        ("[" * 100_000, "this is no episode's configuration"),
        ("null", "an episode of another version: needs .*, got None"),
        ("[1]", "an episode of another version"),
        ('"spot/move_box"', "an episode of another version"),
        ("{}", r"needs \['clock', 'engine', .*, got \[\]"),
        (changed(surprise=1), "an episode of another version"),
        (json.dumps({"task": "spot/move_box"}), "an episode of another version"),
        (changed(planner=None), "has a wrong type: planner"),
        (changed(planner=[1]), "has a wrong type: planner"),
        (changed(planner={}), "planner settings of another version"),
        (changed(planner={**asdict(FULL.planner), "rollouts": 0}), "rollouts must be from 1 to"),
        (changed(seed="1"), "an episode's field has a wrong type"),
        (changed(seed=-1), "seed must be a whole number"),
        (changed(seed=1.5), "has a wrong type: seed"),
        (changed(seed=None), "an episode's field has a wrong type"),
        (changed(task=3), "an episode's field has a wrong type"),
        (changed(task=None), "an episode's field has a wrong type"),
        (changed(weight=3), "an episode's field has a wrong type"),
        (changed(weight="goal=3"), "wrong type"),
        (changed(weight=[3]), "wrong type"),
        (changed(param=[["goal=1,0"]]), "wrong type"),
        (changed(time_limit="long"), "an episode's field has a wrong type"),
        (changed(time_limit=float("nan")), "time limit must be in"),
        (changed(clock="wall"), "unknown clock 'wall'"),
        (changed(clock=["realtime"]), "wrong type: clock"),
        (changed(plant="moon"), "unknown plant 'moon'"),
        (changed(plant=["hard"]), "wrong type"),
        (changed(estimator={}), "wrong type: estimator"),
        (changed(engine=7), "wrong type"),
    ],
)
def test_what_is_no_episode_is_refused_in_one_line(text, message):
    with pytest.raises(UsageError, match=message) as caught:
        EpisodeConfig.from_json(text)
    assert "\n" not in str(caught.value)


def test_weights_and_parameters_are_the_tasks_but_for_what_is_said(move_box):
    cost = FULL.cost(move_box)
    assert cost.weights.tolist() == [80.0, 4.0, 0.1, 2500.0]
    assert cost.parameters.tolist() == [1.0, -0.5, 0.1, 0.05]
    assert EpisodeConfig("spot/move_box").cost(move_box).same(move_box.table.defaults)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weight": ("gaol=1",)}, "unknown cost term 'gaol'; valid: fall, goal, gripper, velocity"),
        ({"param": ("goal=99,0",)}, "parameter 'goal' must be from -8 to 8 m"),
    ],
)
def test_numbers_that_are_not_the_tasks_are_refused_with_the_task(move_box, change, message):
    with pytest.raises(UsageError, match=message):
        replace(FULL, **change).cost(move_box)
