from dataclasses import asdict

import pytest

from sumo_dist.errors import UsageError
from sumo_dist.planner.config import PlannerConfig


def test_defaults_are_the_papers():
    config = PlannerConfig()
    assert (config.horizon, config.rollouts, config.nodes, config.elites) == (1.5, 32, 4, 3)
    assert (config.variance_first, config.variance_last) == (0.02, 0.6)
    assert (config.optimizer, config.spline, config.steps) == ("cem", "linear", 75)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"optimizer": "sgd"}, "unknown optimizer 'sgd'; valid: cem, mppi, ps"),
        ({"spline": "quintic"}, "unknown spline 'quintic'; valid: cubic, linear, zero"),
        ({"rollouts": 0}, "rollouts must be from 1 to"),
        ({"rollouts": 10**9}, "rollouts must be from 1 to"),
        ({"nodes": 0}, "nodes must be from 1 to"),
        ({"nodes": 10**6}, "nodes must be from 1 to"),
        ({"iterations": 0}, "iterations must be from 1 to"),
        ({"elites": 0}, "elites must be from 1 to"),
        ({"horizon": 0.0}, "horizon must be a multiple of 0.02 s up to 20 s, got 0.0"),
        ({"horizon": 0.03}, "horizon must be a multiple of 0.02 s"),
        ({"horizon": 21.0}, "horizon must be a multiple of 0.02 s"),
        ({"horizon": float("nan")}, "horizon must be a multiple of 0.02 s"),
        ({"horizon": float("inf")}, "horizon must be a multiple of 0.02 s"),
        ({"timestep": 0.03}, "timestep must divide 0.02 s"),
        ({"timestep": 0.0}, "timestep must divide 0.02 s"),
        ({"timestep": -0.01}, "timestep must divide 0.02 s"),
        ({"timestep": 1e-9}, "timestep must divide 0.02 s"),
        ({"timestep": float("nan")}, "timestep must divide 0.02 s"),
        ({"variance_first": 0.0}, "variance_first must be positive and below 100"),
        ({"variance_last": float("nan")}, "variance_last must be positive and below 100"),
        ({"temperature": -1.0}, "temperature must be positive and below 100"),
        ({"fluid_density": -1.0}, r"fluid_density must be in \[0, 100\)"),
        ({"fluid_density": float("nan")}, r"fluid_density must be in \[0, 100\)"),
    ],
)
def test_bad_values_say_what_is_valid(change, message):
    with pytest.raises(UsageError, match=message):
        PlannerConfig(**change)


@pytest.mark.parametrize("timestep", [0.02, 0.01, 0.005, 0.004, 0.0025, 0.002, 0.001])
def test_time_steps_that_divide_a_tick_are_valid(timestep):
    assert PlannerConfig(timestep=timestep).timestep == timestep


@pytest.mark.parametrize("steps", [1, 7, 35, 75, 125, 1000])
def test_any_whole_number_of_ticks_is_a_horizon(steps):
    assert PlannerConfig(horizon=steps * 0.02).steps == steps


def test_settings_are_read_as_their_keys_type():
    config = PlannerConfig().with_settings(["rollouts=16", "horizon=2", "spline=cubic"])
    assert (config.rollouts, config.horizon, config.spline) == (16, 2.0, "cubic")
    assert config.nodes == PlannerConfig().nodes


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("rollouts", "setting 'rollouts' is not of the form key=value"),
        ("rolouts=3", "unknown setting 'rolouts'; valid: .*, rollouts, "),
        ("rollouts=many", "setting rollouts needs a value of type int, got 'many'"),
        ("rollouts=3.5", "setting rollouts needs a value of type int, got '3.5'"),
        ("horizon=", "setting horizon needs a value of type float, got ''"),
        ("optimizer=adam", "unknown optimizer 'adam'; valid: cem, mppi, ps"),
    ],
)
def test_bad_settings_say_what_is_valid(setting, message):
    with pytest.raises(UsageError, match=message):
        PlannerConfig().with_settings([setting])


def test_survives_the_wire():
    config = PlannerConfig(optimizer="mppi", horizon=0.8, rollouts=7)
    assert PlannerConfig.from_settings(asdict(config)) == config


@pytest.mark.parametrize(
    "change", [{"rollouts": 3.0}, {"surprise": 1}, {"horizon": 1}, {"spline": 2}]
)
def test_settings_of_another_version_are_refused(change):
    with pytest.raises(UsageError, match="planner settings of another version; valid: optimizer"):
        PlannerConfig.from_settings({**asdict(PlannerConfig()), **change})


def test_missing_settings_are_refused():
    with pytest.raises(UsageError, match="another version"):
        PlannerConfig.from_settings({"rollouts": 3})


def test_the_hash_depends_on_every_setting_and_on_the_task():
    base = PlannerConfig().hash("task")
    assert PlannerConfig().hash("task") == base
    assert PlannerConfig().hash("other") != base
    changes = {"optimizer": "ps", "spline": "zero", "timestep": 0.01}
    for name, value in asdict(PlannerConfig()).items():
        change = {name: changes[name] if name in changes else value + 1}
        assert PlannerConfig(**change).hash("task") != base, name
