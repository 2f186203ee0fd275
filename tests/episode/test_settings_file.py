"""A settings file says what an episode is run with, and what stands beside it wins."""

import tomllib
from dataclasses import replace

import pytest

from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm
from sumo_dist.episode.settings_file import SettingsFile, resolved
from sumo_dist.errors import UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.tasks import load_task

BOX = load_task("spot/move_box")
FILE = """
task = "spot/move_box"
[weights]
goal = 80
gripper = 0.5
[parameters]
goal = [1.0, -0.5]
[planner]
optimizer = "cem"
rollouts = 9
"""


@pytest.fixture
def file(tmp_path):
    """Return a function that writes a settings file."""

    def write(text=FILE):
        path = tmp_path / "settings.toml"
        path.write_text(text)
        return path

    return write


def settings(file, task=BOX, preset="default", optimizer=None, changes=(), weight=(), param=()):
    return resolved(task, file, preset, optimizer, changes, weight, param)


def test_a_file_goes_over_the_task_and_the_command_line_over_it(file):
    found = settings(file())
    assert found["planner"] == PlannerConfig(optimizer="cem", rollouts=9)
    assert found["weight"] == ("goal=80.0", "gripper=0.5")
    assert found["param"] == ("goal=1.0,-0.5",)
    given = {"changes": ("rollouts=12",), "weight": ("goal=3",), "param": ("goal=2,2",)}
    found = settings(file(), optimizer="icem", **given)
    assert found["planner"] == PlannerConfig.preset("default", "icem").changed({"rollouts": 12})
    assert found["weight"] == ("gripper=0.5", "goal=3")
    assert found["param"] == ("goal=2,2",)
    long = replace(BOX, planner={"horizon": 2.0, "rollouts": 30})
    assert settings(file(), long)["planner"].horizon == 2.0
    assert settings(file(), long)["planner"].rollouts == 9


def test_without_a_file_all_is_as_before():
    found = settings(None, preset="paper", weight=("goal=3",))
    assert found == {"planner": PlannerConfig.preset("paper"), "weight": ("goal=3",), "param": ()}


def test_what_is_written_is_read_back(file):
    odd = CostTerm('a "b" ü', BOX.cost[0].residual, 0.1)
    task = replace(
        BOX, cost=(*BOX.cost, odd), parameters=(*BOX.parameters, Parameter("slope", 1 / 3))
    )
    cost = task.table.adjusted(("goal=0.30000000000000004",), ("goal=1,2",))
    planner = PlannerConfig(horizon=0.7, optimizer="mppi")
    origin = {"command": 'say "hi" \\ \t', "seeds": [1, 2], "loss": 0.25}
    made = SettingsFile.of(task, planner, cost, origin)
    assert SettingsFile.read(file(made.toml)) == made
    found = settings(file(made.toml), task)
    assert found["planner"] == planner
    assert task.table.adjusted(found["weight"], found["param"]).same(cost)
    assert tomllib.loads(made.toml)["parameters"]["slope"] == 1 / 3


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("goal = ", "settings.toml is not TOML: "),
        ("[weight]\ngoal = 1", "unknown entry 'weight'; valid: origin, parameters, planner, task,"),
        ("weights = 3", "weights must be a table, got 3"),
        ("task = 3", "task must be a text, got 3"),
        ("[weights]\ngoal = 'a'", "weight 'goal' must be a number, got 'a'"),
        ("[weights]\ngoal = true", "weight 'goal' must be a number, got True"),
        ("[weights]\ngoal = inf", "weight of 'goal' must be a finite number, got inf"),
        ("[weights]\ngaol = 1", "unknown cost term 'gaol'; valid: fall, goal, gripper, velocity"),
        ("[parameters]\ngoal = 1.0", "parameter 'goal' needs 2 finite numbers"),
        ("[parameters]\ngoal = ['a']", "parameter 'goal' must be numbers, got ['a']"),
        ("[parameters]\ngoal = [99, 0]", "parameter 'goal' must be from -8 to 8 m"),
        ("[planner]\nrolouts = 3", "unknown setting 'rolouts'; valid: "),
        ("[planner]\nrollouts = 0", "rollouts must be from 1 to 4096, got 0"),
        ("[planner]\nrollouts = 3.5", "setting rollouts needs a value of type int, got 3.5"),
        ("task = 'spot/move_cone'", "it is for spot/move_cone, not spot/move_box; without its li"),
    ],
)
def test_what_is_no_settings_file_is_one_line_that_names_it(file, text, said):
    with pytest.raises(UsageError) as caught:
        settings(file(text))
    assert said in str(caught.value) and "settings.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_preset_beside_a_file_with_planner_settings_is_refused(file, tmp_path):
    with pytest.raises(UsageError, match=r"--preset paper and --settings .*; give one of them"):
        settings(file(), preset="paper")
    weights = file("[weights]\ngoal = 80")
    assert settings(weights, preset="paper")["planner"] == PlannerConfig.preset("paper")
    with pytest.raises(UsageError, match=r"no settings file at .*: No such file or directory"):
        settings(tmp_path / "none.toml")
