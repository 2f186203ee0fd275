import json
from dataclasses import asdict

from sumo_dist.commands.list import Options, main
from sumo_dist.optim import OPTIMIZERS
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.rollout import ENGINES
from sumo_dist.tasks import task_names


def test_lists_tasks_optimizers_engines_and_settings(capsys):
    assert main(Options()) == 0
    shown = capsys.readouterr().out
    for name in (*task_names(), *OPTIMIZERS, *ENGINES, *asdict(PlannerConfig())):
        assert name in shown
    assert "success_radius             0.1  0, 1 m" in shown


def test_lists_them_as_json(capsys):
    assert main(Options(json=True)) == 0
    listing = json.loads(capsys.readouterr().out)
    assert set(listing["tasks"]) == set(task_names())
    box = listing["tasks"]["spot/move_box"]
    assert box["robot"] == "spot"
    assert box["time_limit_s"] == 30.0
    assert box["cost"] == {"goal": 60.0, "gripper": 4.0, "velocity": 20.0, "fall": 2500.0}
    assert list(box["parameters"]) == ["goal", "success_radius", "success_speed"]
    goal = box["parameters"]["goal"]
    assert (goal["default"], goal["unit"], goal["range"]) == ([0.0, 0.0], "m", [-8.0, 8.0])
    assert tuple(listing["optimizers"]) == OPTIMIZERS
    assert tuple(listing["engines"]) == ENGINES
    assert listing["settings"]["rollouts"] == PlannerConfig().rollouts
