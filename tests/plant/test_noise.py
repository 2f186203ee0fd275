"""Plants that are not the planner's model."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from sumo_dist.episode.assemble import make_plant
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.episode.summary import summarise
from sumo_dist.errors import UsageError
from sumo_dist.model.scene import PLANT, ModelOptions, compile_model
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.plant.noise import (
    NOMINAL,
    PLANTS,
    CommandLink,
    NoisySensors,
    PlantProfile,
    plant_profile,
)
from sumo_dist.plant.simulated import Plant
from sumo_dist.robots.spot import SPOT

USUAL = ModelOptions(PLANT.timestep, PLANT.fluid_density)
STAND = np.array(SPOT.stand)
POSES = np.tile([1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0], (2, 1))


def perturbed(scene, state, seed, name="perturbed"):
    return Plant(scene, state, profile=PLANTS[name], seed=seed).model


@pytest.mark.parametrize(("name", "width"), [("perturbed", 0.1), ("hard", 0.25)])
def test_bodies_and_servos_deviate_within_the_stated_width(move_box, first_state, name, width):
    usual = compile_model(move_box.scene, USUAL)
    model, profile = perturbed(move_box.scene, first_state, 1, name), PLANTS[name]
    heavy = usual.body_mass > 0
    mass = model.body_mass[heavy] / usual.body_mass[heavy] - 1
    assert 0.3 * width < np.abs(mass).max() <= width
    stiffness = model.actuator_gainprm[:, 0] / usual.actuator_gainprm[:, 0] - 1
    assert 0 < np.abs(stiffness).max() <= profile.spread.stiffness
    assert np.array_equal(model.actuator_gainprm[:, 0], -model.actuator_biasprm[:, 1])
    sliding = model.geom_friction[:, 0] / usual.geom_friction[:, 0] - 1
    assert 0 < np.abs(sliding).max() <= profile.spread.friction + 1e-12
    assert model.opt.timestep == 0.001


def test_an_object_is_one_piece_and_differs_between_seeds(move_box, first_state):
    usual = compile_model(move_box.scene, USUAL)
    box = usual.body("box").id
    ratios = {
        round(perturbed(move_box.scene, first_state, seed).body_mass[box] / usual.body_mass[box], 9)
        for seed in (1, 2, 1)
    }
    assert len(ratios) == 2


def test_a_seed_decides_every_bit_of_a_disturbed_plant(move_box, go):
    def states(seed):
        config = EpisodeConfig("spot/move_box", seed, plant="hard", estimator="lowpass")
        plant, seen = make_plant(config, move_box), []
        for i in range(10):
            go(plant, STAND + 0.02 * np.sin(i))
            readings = plant.read()
            seen += [plant.truth, readings.encoders, readings.mocap]
        return np.concatenate([np.ravel(each) for each in seen])

    assert np.array_equal(states(1), states(1))
    assert not np.array_equal(states(1)[:50], states(2)[:50])


def test_the_nominal_plant_is_what_it_always_was(move_box, first_state, plant, go):
    for i in range(5):
        go(plant, STAND + 0.01 * i)
    again = Plant(move_box.scene, first_state, profile=NOMINAL, seed=9)
    for i in range(5):
        go(again, STAND + 0.01 * i)
    assert np.array_equal(plant.truth, again.truth)


def test_a_command_takes_its_time_and_a_lost_one_never_comes():
    link = CommandLink(PlantProfile(command_delay_ms=7.0), seed=0)
    for tick in range(3):
        link.send(20.0 * tick, np.full(2, float(tick)))
    assert [link.at(t)[0] for t in (0.0, 26.9, 27.0, 46.0, 47.0)] == [0.0, 0.0, 1.0, 1.0, 2.0]
    deaf = CommandLink(PlantProfile(command_loss=1.0), seed=0)
    for tick in range(5):
        deaf.send(20.0 * tick, np.full(2, float(tick)))
    assert deaf.at(1000.0)[0] == 0.0  # the first came: there was something to hold


def test_a_command_that_was_overtaken_is_not_carried_out():
    link = CommandLink(PlantProfile(command_jitter_ms=40.0), seed=3)
    held = []
    for tick in range(200):
        link.send(20.0 * tick, np.full(1, float(tick)))
        held += [link.at(20.0 * tick + ms)[0] for ms in range(20)]
    assert held == sorted(held)
    assert 50 < len(set(held)) < 200


def test_shares_of_lost_late_and_wrong_frames_are_as_stated():
    profile = replace(PLANTS["hard"], mocap_gap=0.0)
    sensors, seen = NoisySensors(profile, seed=0), 0
    wrong, off = 0, []
    for stamp in range(0, 80_000, 8):
        sensors.expose(stamp, POSES)
        for sent, poses in sensors.arrived(stamp):
            assert sent <= stamp - profile.mocap_delay_ms
            seen += 1
            error = np.abs(poses[:, :3] - POSES[:, :3]).max(axis=1)
            wrong += np.count_nonzero(error > 0.02)
            off += error[error < 0.02].tolist()
    assert seen == pytest.approx(10_000 * 0.95, rel=0.01)
    assert wrong / (2 * seen) == pytest.approx(profile.mocap_outlier, rel=0.25)
    assert np.max(off) < 5 * profile.mocap_m


def test_a_gap_hides_everything_for_as_long_as_stated():
    sensors = NoisySensors(PlantProfile(mocap_gap=1.0, mocap_gap_ms=50), seed=0)
    for stamp in range(0, 200, 10):
        sensors.expose(stamp, POSES)
    assert [stamp for stamp, _ in sensors.arrived(200)] == [0, 50, 100, 150]


def test_an_unknown_plant_names_the_valid_ones():
    with pytest.raises(UsageError, match="unknown plant 'moon'; valid: hard, nominal, perturbed"):
        EpisodeConfig("spot/move_box", plant="moon")


@pytest.mark.slow
def test_a_disturbed_run_repeats_and_says_what_it_was_disturbed_by():
    def digests():
        config = EpisodeConfig(
            *("spot/move_box", 2, PlannerConfig(rollouts=6, horizon=0.2)),
            estimator="lowpass",
            time_limit=0.4,
            plant="hard",
        )
        recording, ending = run_single(config, threads=1)
        assert recording.config["plant_profile"] == asdict(plant_profile("hard"))
        summary = summarise(recording, ending)
        assert summary["plant"] == "hard"
        return summary["state_digest"], summary["plan_digest"]

    assert digests() == digests()
