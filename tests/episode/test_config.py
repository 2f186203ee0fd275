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
    config = EpisodeConfig("spot/move_box", seed=2**62, planner=planner)
    problem = Problem.build(move_box, planning_options(planner))
    described = config.describe(problem, "native-avx2")
    assert (described["task"], described["robot"]) == ("spot/move_box", "spot")
    assert (described["seed"], described["optimizer"]) == (2**62, "mppi")
    assert described["engine"] == "native-avx2"
    assert described["planner"]["rollouts"] == 5
    assert described["terms"] == ["goal", "gripper", "velocity", "fall"]
    assert described["task_hash"] == problem.hash
    assert described["config_hash"] == planner.hash(problem.hash)
    assert {"sumo-dist", "mujoco", "numpy", "python"} <= set(described["versions"])
