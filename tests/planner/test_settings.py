from dataclasses import asdict, fields

import pytest

from sumo_dist.errors import UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.settings import SETTINGS


def test_every_setting_is_described_and_its_default_is_valid():
    assert list(SETTINGS) == [field.name for field in fields(PlannerConfig)]
    for name, default in asdict(PlannerConfig()).items():
        assert SETTINGS[name].accepts(default)
        assert SETTINGS[name].about
        assert SETTINGS[name].valid


def test_defaults_then_the_tasks_then_what_is_asked_for():
    task = {"horizon": 2.5, "nodes": 5}
    assert PlannerConfig.resolve({}) == PlannerConfig()
    assert PlannerConfig.resolve(task) == PlannerConfig(horizon=2.5, nodes=5)
    asked = PlannerConfig.resolve(task, settings=["nodes=6", "rollouts=8"])
    assert asked == PlannerConfig(horizon=2.5, nodes=6, rollouts=8)
    paper = PlannerConfig.resolve(task, "paper")
    assert (paper.horizon, paper.timestep) == (2.5, 0.01)


def test_an_optimizer_comes_with_its_settings_and_the_one_asked_for_wins():
    icem = PlannerConfig.resolve({"optimizer": "icem", "iterations": 3})
    assert (icem.optimizer, icem.iterations, icem.execute) == ("icem", 3, "best")
    other = PlannerConfig.resolve({"optimizer": "icem", "rollouts": 12}, optimizer="cem")
    assert other == PlannerConfig("cem", rollouts=12)
    given = PlannerConfig.resolve({"iterations": 1, "rollouts": 16}, optimizer="icem")
    assert (given.iterations, given.rollouts) == (2, 16)


def test_whole_numbers_are_times_too():
    assert PlannerConfig().changed({"horizon": 2}) == PlannerConfig(horizon=2.0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rolouts": 3}, "unknown setting 'rolouts'; valid: .*rollouts"),
        ({"rollouts": 3.0}, "setting rollouts needs a value of type int, got 3.0"),
        ({"rollouts": True}, "setting rollouts needs a value of type int, got True"),
        ({"rollouts": "3"}, "setting rollouts needs a value of type int, got '3'"),
        ({"horizon": "1"}, "setting horizon needs a value of type float, got '1'"),
        ({"horizon": None}, "setting horizon needs a value of type float, got None"),
        ({"horizon": float("nan")}, "horizon must be a multiple"),
        ({"spline": 3}, "setting spline needs a value of type str, got 3"),
        ({"optimizer": "sgd"}, "unknown optimizer 'sgd'; valid: cem"),
        ({"elites": 0}, "elites must be from 1 to 4096, got 0"),
    ],
)
def test_wrong_settings_name_what_is_valid(settings, message):
    with pytest.raises(UsageError, match=message):
        PlannerConfig.resolve(settings)
