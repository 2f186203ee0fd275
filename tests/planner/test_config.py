from dataclasses import asdict, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_dist.errors import UsageError
from sumo_dist.model.scene import PLANT
from sumo_dist.planner.config import PRESETS, PlannerConfig
from sumo_dist.planner.problem import planning_options


def test_defaults_look_as_far_and_search_as_wide_as_the_paper():
    config = PlannerConfig()
    assert (config.horizon, config.steps) == (1.5, 75)
    assert (config.variance_first, config.variance_last) == (0.02, 0.6)
    assert (config.spline, config.nodes) == ("smooth", 5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"optimizer": "sgd"}, "unknown optimizer 'sgd'; valid: cem, cma, icem, mppi, ps"),
        ({"spline": "quintic"}, "unknown spline 'quintic'; valid: cubic, linear, smooth, zero"),
        ({"rollouts": 0}, "rollouts must be from 1 to"),
        ({"rollouts": 10**9}, "rollouts must be from 1 to"),
        ({"rate": 0}, "rate must be from 1 to 50, got 0"),
        ({"rate": 51}, "rate must be from 1 to 50, got 51"),
        ({"nodes": 0}, "nodes must be from 1 to"),
        ({"nodes": 10**6}, "nodes must be from 1 to"),
        ({"nodes": 2}, "a smooth spline needs at least 3 nodes, got 2"),
        ({"iterations": 0}, "iterations must be from 1 to"),
        ({"iterations": 17}, "17 iterations need at least as many rollouts, got 16"),
        ({"decay": 0.9}, "decay must be from 1 to 10, got 0.9"),
        ({"decay": float("nan")}, "decay must be from 1 to 10"),
        ({"noise_exponent": -1.0}, "noise_exponent must be from 0 to 4, got -1.0"),
        ({"noise_exponent": float("nan")}, "noise_exponent must be from 0 to 4"),
        ({"placement": "far"}, "unknown placement 'far'; valid: alike, near"),
        ({"execute": "median"}, "unknown execute 'median'; valid: best, mean"),
        ({"elites": 0}, "elites must be from 1 to"),
        ({"horizon": 0.0}, "horizon must be a multiple of 0.02 s up to 20 s, got 0.0"),
        ({"horizon": 0.03}, "horizon must be a multiple of 0.02 s"),
        ({"horizon": 21.0}, "horizon must be a multiple of 0.02 s"),
        ({"horizon": float("nan")}, "horizon must be a multiple of 0.02 s"),
        ({"horizon": float("inf")}, "horizon must be a multiple of 0.02 s"),
        ({"timestep": 0.03}, "timestep must be a whole fraction of 0.02 s"),
        ({"timestep": 0.0}, "timestep must be a whole fraction of 0.02 s"),
        ({"timestep": -0.01}, "timestep must be a whole fraction of 0.02 s"),
        ({"timestep": 1e-9}, "timestep must be a whole fraction of 0.02 s"),
        ({"timestep": float("nan")}, "timestep must be a whole fraction of 0.02 s"),
        ({"variance_first": 0.0}, "variance_first must be positive and below 100"),
        ({"variance_last": float("nan")}, "variance_last must be positive and below 100"),
        ({"base_noise": 0.0}, "base_noise must be positive and below 100"),
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
        ("optimizer=adam", "unknown optimizer 'adam'; valid: cem, cma, icem, mppi, ps"),
    ],
)
def test_bad_settings_say_what_is_valid(setting, message):
    with pytest.raises(UsageError, match=message):
        PlannerConfig().with_settings([setting])


def test_survives_the_wire():
    config = PlannerConfig(optimizer="mppi", horizon=0.8, rollouts=7)
    assert PlannerConfig.from_settings(asdict(config)) == config
    # settings that there were not always
    since = "model", "guidance", "placement", "rate", "policy", "guided"
    before = {name: value for name, value in asdict(config).items() if name not in since}
    assert PlannerConfig.from_settings(before) == replace(config, model="full")


@pytest.mark.parametrize(
    "change", [{"rollouts": 3.0}, {"surprise": 1}, {"horizon": 1}, {"spline": 2}]
)
def test_settings_of_another_version_are_refused(change):
    with pytest.raises(UsageError, match="planner settings of another version; valid: optimizer"):
        PlannerConfig.from_settings({**asdict(PlannerConfig()), **change})


def test_a_learned_policy_and_guidance_by_it_go_together():
    config = PlannerConfig().with_settings(["guidance=learned", "policy=a.onnx"])
    assert config.policy == str(Path("a.onnx").absolute())
    for alone in (["guidance=learned"], ["policy=a.onnx"], ["guidance=object", "policy=a.onnx"]):
        with pytest.raises(UsageError, match="guidance=learned needs policy=FILE, and nothing els"):
            PlannerConfig().with_settings(alone)


def test_missing_settings_are_refused():
    with pytest.raises(UsageError, match="another version"):
        PlannerConfig.from_settings({"rollouts": 3})


def test_the_hash_depends_on_every_setting_and_on_the_task():
    base = PlannerConfig().hash("task")
    assert PlannerConfig().hash("task") == base
    assert PlannerConfig().hash("other") != base
    changes = {"optimizer": "cem", "spline": "zero", "timestep": 0.01, "execute": "best"}
    changes |= {"model": "full", "guidance": "object", "placement": "near"}
    for name, value in asdict(PlannerConfig()).items():
        if name == "policy":
            change = {"guidance": "learned", "policy": "a.onnx"}
        else:
            change = {name: changes[name] if name in changes else value + 1}
        assert PlannerConfig(**change).hash("task") != base, name


@pytest.mark.parametrize(
    ("settings", "populations"),
    [
        ({}, (32,)),
        ({"iterations": 2}, (16, 16)),
        ({"iterations": 3}, (11, 10, 11)),
        ({"iterations": 3, "decay": 1.25}, (13, 10, 9)),
        ({"iterations": 4, "decay": 10.0}, (26, 4, 1, 1)),
        ({"iterations": 32}, (1,) * 32),
    ],
)
def test_iterations_divide_the_rollouts(settings, populations):
    assert PlannerConfig(rollouts=32, **settings).populations == populations


@given(st.integers(1, 300), st.integers(1, 100), st.floats(1, 10))
def test_every_iteration_has_a_candidate_and_none_is_lost(rollouts, iterations, decay):
    iterations = min(iterations, rollouts)
    config = PlannerConfig(rollouts=rollouts, iterations=iterations, decay=decay)
    assert len(config.populations) == iterations
    assert sum(config.populations) == rollouts
    assert min(config.populations) >= 1


def test_the_papers_preset_is_what_the_paper_prints():
    paper = PlannerConfig.preset("paper")
    assert (paper.optimizer, paper.elites, paper.iterations) == ("cem", 3, 1)
    assert (paper.horizon, paper.rollouts, paper.nodes, paper.spline) == (1.5, 32, 4, "linear")
    assert (paper.variance_first, paper.variance_last) == (0.02, 0.6)
    assert (paper.noise_exponent, paper.placement, paper.execute) == (0.0, "alike", "mean")
    assert planning_options(paper) == replace(PLANT, visuals=False)


def test_better_defaults_do_not_reach_the_papers_preset():
    """Only settings of other optimizers may be left to the defaults."""
    left = {"temperature"}
    assert set(PRESETS["paper"]) == set(asdict(PlannerConfig())) - left


def test_a_preset_takes_another_optimizer():
    config = PlannerConfig.preset("paper", "mppi")
    assert (config.optimizer, config.timestep) == ("mppi", 0.01)


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_optimizers_that_adapt_within_a_plan_get_iterations_to_do_so(preset):
    given_ = PlannerConfig.preset(preset)
    cma, icem = (PlannerConfig.preset(preset, name) for name in ("cma", "icem"))
    assert cma == replace(given_, optimizer="cma", iterations=2)
    assert (icem.iterations, icem.decay, icem.execute) == (2, 1.25, "best")
    assert icem.noise_exponent > 0
    assert sum(icem.populations) == given_.rollouts
    assert icem.with_settings(["iterations=3"]).iterations == 3


def test_an_unknown_optimizer_of_a_preset_names_the_valid_ones():
    with pytest.raises(UsageError, match="unknown optimizer 'sgd'; valid: cem, cma, icem"):
        PlannerConfig.preset("paper", "sgd")


def test_an_unknown_preset_names_the_valid_ones():
    with pytest.raises(UsageError, match="unknown preset 'fast'; valid: default, paper"):
        PlannerConfig.preset("fast")
