import numpy as np
import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.model.index import StateIndex
from sumo_dist.plant.simulated import Plant, mocap_times_ms
from sumo_dist.robots.spot import SPOT


@pytest.fixture
def sensed(move_box, first_state):
    return Plant(move_box.scene, first_state, "lowpass")


def test_starts_at_the_given_state(plant, first_state):
    assert plant.tick == 0
    assert np.array_equal(plant.truth, first_state)
    assert np.array_equal(plant.read().truth, first_state)


@pytest.mark.parametrize("estimator", ["truth", "lowpass"])
def test_a_tick_is_20_ms_of_physics(move_box, first_state, plant, estimator, go):
    """On steps of 0.01 and of 0.001 s: a box in the air covers its speed's worth either way."""
    index, state = StateIndex(plant.model), first_state.copy()
    state[index.pose("box")][2] = 1.0
    state[index.velocity("box")][0] = 1.0
    coasting = Plant(move_box.scene, state, estimator)
    for _ in range(5):
        go(coasting, np.array(SPOT.stand))
    assert coasting.tick == 5
    assert (coasting.truth - state)[index.pose("box")][0] == pytest.approx(0.1, rel=0.02)


def test_the_same_targets_give_the_same_bits(move_box, first_state, go):
    def states():
        plant = Plant(move_box.scene, first_state)
        for i in range(10):
            go(plant, np.array(SPOT.stand) + 0.01 * i)
        return plant.truth

    assert np.array_equal(states(), states())


@pytest.mark.parametrize("size", [0, 50, 52])
def test_an_initial_state_of_another_shape_is_refused(move_box, size):
    with pytest.raises(UsageError, match=rf"initial state has shape \({size},\), needs \(\d+,\)"):
        Plant(move_box.scene, np.zeros(size))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_joint_targets_that_are_not_finite_are_a_named_fault(plant, value, go):
    go(plant, np.array(SPOT.stand))
    with pytest.raises(SumoError, match="joint targets are not finite at tick 1"):
        plant.send(np.full(len(SPOT.joints), value))


@pytest.mark.parametrize("speed", [1e9, 1e12])
def test_a_simulation_that_diverges_is_a_named_fault(
    move_box, first_state, tmp_path, monkeypatch, speed, go
):
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a log there
    state = first_state.copy()
    state[-6:] = speed  # of the box
    plant = Plant(move_box.scene, state)
    with pytest.raises(SumoError, match="the simulation diverged at tick 1"):
        go(plant, np.array(SPOT.stand))


def test_motion_capture_sends_at_120_hz():
    stamps = mocap_times_ms(-1, 999)
    assert len(stamps) == 120
    assert stamps[:4].tolist() == [0, 8, 17, 25]
    ticks = [mocap_times_ms(tick * 20, tick * 20 + 20) for tick in range(50)]
    assert [0, *np.concatenate(ticks)][:120] == stamps.tolist()


def test_sensors_send_packets_and_no_truth(sensed, first_state, go):
    index = StateIndex(sensed.model)
    first = sensed.read()
    assert first.truth.size == 0
    assert first.encoder_ms.tolist() == [0]
    assert first.mocap_ms.tolist() == [0]
    positions, _ = index.joints(SPOT.joints)
    assert np.array_equal(first.encoders[0, : len(SPOT.joints)], first_state[positions])
    assert np.array_equal(first.mocap[0], [first_state[index.pose(b)] for b in index.free_bodies])
    stamps = []
    for _ in range(3):
        go(sensed, np.array(SPOT.stand))
        readings = sensed.read()
        stamps.append((readings.encoder_ms.tolist(), readings.mocap_ms.tolist()))
        assert len(readings.encoders) == len(readings.encoder_ms)
        assert len(readings.mocap) == len(readings.mocap_ms)
    assert stamps == [
        ([3, 6, 9, 12, 15, 18], [8, 17]),
        ([21, 24, 27, 30, 33, 36, 39], [25, 33]),
        ([42, 45, 48, 51, 54, 57, 60], [42, 50, 58]),
    ]


def test_no_time_passes_but_by_advancing(plant, first_state):
    """A body that is told something, or looked at, holds still: that is what a pause rests on."""
    assert plant.can_hold
    plant.send(np.array(SPOT.stand) + 0.1)
    plant.read()
    assert plant.tick == 0
    assert np.array_equal(plant.truth, first_state)


def test_servos_hold_what_they_were_told_last(move_box, first_state):
    once, often = Plant(move_box.scene, first_state), Plant(move_box.scene, first_state)
    targets = np.array(SPOT.stand) + 0.05
    once.send(targets)
    for _ in range(5):
        once.advance()
        often.send(targets)
        often.advance()
    assert np.array_equal(once.truth, often.truth)
    other = Plant(move_box.scene, first_state)
    for last in (-0.05, 0.05):  # of two within a tick the later counts
        other.send(np.array(SPOT.stand) + last)
    other.advance()
    twin = Plant(move_box.scene, first_state)
    twin.send(targets)
    twin.advance()
    assert np.array_equal(other.truth, twin.truth)
