import json
import re
from dataclasses import asdict

import pytest

from sumo_dist.commands.list import Options, main
from sumo_dist.errors import UsageError
from sumo_dist.optim import OPTIMIZERS
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.settings import SETTINGS
from sumo_dist.rollout import ENGINES
from sumo_dist.tasks import load_task, task_names

TASK = """
from dataclasses import replace
from sumo_dist.tasks import load_task

def task():
    return replace(load_task("spot/move_cone"), name="mine", planner={"rollouts": 16},
                   description="Spot shoves\\n  it")
"""


def test_every_task_and_setting_has_a_line_that_describes_it(capsys):
    assert main(Options()) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in task_names():
        (line,) = [line for line in lines if line.split()[:1] == [name]]
        assert load_task(name).description in line
        assert len(load_task(name).description) > 20
    for name, default in asdict(PlannerConfig()).items():
        (line,) = [line for line in lines if line.split()[:2] == [name, str(default) or "-"]]
        assert line.endswith(f"{SETTINGS[name].about}; {SETTINGS[name].valid}")
    assert f"optimizers: {', '.join(OPTIMIZERS)}" in lines
    assert f"engines:    {', '.join(ENGINES)}" in lines


def test_a_tasks_own_settings_stand_beside_it(capsys):
    main(Options())
    shown = capsys.readouterr().out
    assert re.search("g1/door_open +G1 pushes open a door", shown)
    assert shown.count("(optimizer=cem, horizon=2.5, nodes=7, base_noise=1.0)") == 4


def test_one_task_is_shown_in_full(capsys, tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(TASK)
    assert main(Options(task=("spot/move_box", str(file)))) == 0
    shown = capsys.readouterr().out
    assert "success_radius             0.1  0, 1 m" in shown
    assert "planner         rollouts=16" in shown
    assert "upright" not in shown


def test_an_unknown_task_names_the_valid_ones():
    with pytest.raises(UsageError, match=r"unknown task .spot/fly.; valid: .*spot/move_box"):
        main(Options(task=("spot/fly",)))


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
    assert box["settings"] == {}
    assert listing["tasks"]["g1/box_push"]["settings"]["horizon"] == 2.5
    assert tuple(listing["optimizers"]) == OPTIMIZERS
    assert tuple(listing["engines"]) == ENGINES
    assert listing["settings"]["rollouts"] == PlannerConfig().rollouts
    assert listing["valid"]["rollouts"] == "from 1 to 4096"
