"""When a robot must stop, and how it sits down and gets up again."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.ending import End, Ending, fault
from sumo_dist.episode.safety import StateWatch, getting_up, sitting_down
from sumo_dist.math.rotations import from_rotation_vector
from sumo_dist.model.index import StateIndex
from sumo_dist.model.settle import settled_stand
from sumo_dist.plant.simulated import Plant
from sumo_dist.policies import load_policy
from sumo_dist.robots.g1 import G1
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.robots.safety import tilt
from sumo_dist.robots.spot import SPOT
from sumo_dist.timing import TICK


@pytest.fixture
def watch(plant):
    return StateWatch(SPOT, plant.model.nq)


def leaning(state, angle):
    state = state.copy()
    state[3:7] = from_rotation_vector(np.array([angle, 0.0, 0.0]))
    return state


def test_a_fresh_level_state_is_fine(watch, first_state):
    assert watch.trip(7, (7, first_state)) is None
    assert watch.trip(12, (7, first_state)) is None


def test_without_a_fresh_state_it_stops(watch, first_state):
    assert watch.trip(0, None) == fault("no state for 0.1 s")
    assert watch.trip(13, (7, first_state)) == fault("no state for 0.1 s")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_state_that_is_not_finite_stops_it(watch, first_state, value):
    first_state = first_state.copy()
    first_state[-1] = value
    assert watch.trip(0, (0, first_state)) == fault("the state is not finite")


def test_a_racing_joint_stops_it(watch, first_state, plant):
    _, velocities = StateIndex(plant.model).joints(SPOT.joints)
    state = first_state.copy()
    state[velocities[4]] = -31.0
    assert watch.trip(0, (0, state)) == fault("a joint at 31 rad/s, at most 30")
    state[velocities[4]] = -29.0
    assert watch.trip(0, (0, state)) is None


def test_a_fall_is_a_lean_that_lasts(watch, first_state):
    fallen = leaning(first_state, 1.2)
    lasting = round(SPOT.safety.fall_s / TICK)
    assert [watch.trip(t, (t, fallen)) for t in range(lasting)] == [None] * lasting
    assert watch.trip(lasting, (lasting, fallen)) == Ending(End.FELL)
    assert watch.trip(lasting + 1, (lasting + 1, first_state)) is None  # it has come up
    assert watch.trip(lasting + 2, (lasting + 2, fallen)) is None  # and the time starts anew


def test_it_gets_up_only_from_a_level_and_known_state(watch, first_state):
    assert watch.may_rise(3, (3, first_state)) == ""
    assert watch.may_rise(90, (3, first_state)) == "no state for 0.1 s"
    assert watch.may_rise(3, (3, leaning(first_state, 0.5))) == (
        "it lies 29 deg from level, at most 20"
    )


def test_a_robot_that_cannot_get_up_stays_down():
    level = np.concatenate([settled_stand(G1), np.zeros(35)])
    watch = StateWatch(G1, 36)
    assert watch.trip(3, (3, level)) is None
    assert watch.may_rise(3, (3, level)) == "it cannot get up by itself"


def wandering(task, plant, policy, seed):
    """Walk by random commands; yield the plant and the last targets every 0.4 s."""
    rng, memory = np.random.default_rng(seed), policy.initial_memory()
    nq, after = plant.model.nq, task.actions.default
    for tick in range(160):
        if tick % 25 == 0:
            draw = np.clip(rng.normal(0.0, [1.5] * 3 + [0.5] * 6), -1.0, 1.0)
            before, after = after, task.actions.physical(draw)
        command = task.actions.to_command(before + (after - before) * (tick % 25) / 25)
        now = plant.truth
        targets, memory = policy.step(now[:nq], now[nq:], command, memory)
        plant.send(targets)
        plant.advance()
        if tick > 60 and tick % 20 == 0:
            yield targets


def leans_when_stopped(move_box, first_state, robot):
    """Worst and last lean [rad] of sitting down from 20 states of `wandering`, (20, 2)."""
    index = StateIndex(Plant(move_box.scene, first_state).model)
    away, policy = first_state.copy(), load_policy("spot")
    away[index.pose("box")][:2] = 9.0
    found = []
    for seed in range(5):
        plant = Plant(move_box.scene, away)
        for targets in wandering(move_box, plant, policy, seed):
            stopping, leans = Plant(move_box.scene, plant.truth), []
            for down in sitting_down(robot, targets):
                stopping.send(down)
                stopping.advance()
                leans.append(tilt(stopping.truth))
            found.append((max(leans), leans[-1]))
    assert len(found) == 20
    return np.array(found)


@pytest.mark.slow
def test_it_rolls_over_from_no_gait_as_it_would_if_all_joints_took_as_long(move_box, first_state):
    """At full speed in changing directions, the arm in motion."""
    leans = leans_when_stopped(move_box, first_state, SPOT)
    assert leans.max() < np.radians(45)
    assert leans[:, 1].max() < np.radians(10)
    together = replace(SPOT, safety=replace(SPOT.safety, stop_s=0.7))
    rolled = leans_when_stopped(move_box, first_state, together)[:, 0] > np.radians(90)
    assert rolled.sum() >= 2


@pytest.mark.slow
@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.6, 0.0, 0.0), (0.3, 0.3, 0.6)])
def test_it_sits_down_from_any_walk_and_gets_up_again(move_box, first_state, velocity):
    """Without the policy, which needs a state; no fall, level at the end, and it walks again."""
    index = StateIndex(Plant(move_box.scene, first_state).model)
    state = first_state.copy()
    state[index.pose("box")][:2] = 9.0
    plant = Plant(move_box.scene, state)
    guard = CommandGuard(SPOT, plant.model, plant.send, TICK)
    policy, nq = load_policy("spot"), plant.model.nq
    command = np.array(SPOT.default_command)

    def go(targets):
        guard.send(targets)
        plant.advance()
        return tilt(plant.truth)

    def walk(ticks, velocity):
        command[:3], memory = velocity, policy.initial_memory()
        for _ in range(ticks):
            now = plant.truth
            targets, memory = policy.step(now[:nq], now[nq:], command, memory)
            yield go(targets)

    list(walk(100, velocity))
    tilts = [go(targets) for targets in sitting_down(SPOT, guard.last)]
    assert max(tilts) < np.radians(45)
    assert tilts[-1] < np.radians(5)
    assert plant.truth[2] < 0.3
    for targets in getting_up(SPOT, guard.last):
        go(targets)
    assert plant.truth[2] > 0.25  # the servos alone do not carry it higher
    assert max(walk(150, velocity)) < np.radians(25)  # the policy takes over
    assert plant.truth[2] > 0.45
