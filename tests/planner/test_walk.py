import cmath
from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.planner.walk import Gait, Ground, walk
from sumo_dist.timing import TICK

GAIT = Gait((-0.7, -0.7, -0.7), (0.7, 0.7, 0.7), settling=0.5)
# A box 0.5 m wide at the origin, to go 2 m along x; the robot is 0.5 m long ahead of its base.
BEHIND = Ground(
    base=-1.5 + 0.0j,
    heading=1.0 + 0.0j,
    centre=0.0j,
    way=2.0 + 0.0j,
    back=0.25,
    width=0.5,
    reach=0.5,
    keep=0.85,
)
LONG = 600  # ticks, in which any of these walks comes to its end


def path(ground, velocities):
    """Places and headings of a base that has these velocities, the start among them."""
    base, heading = ground.base, ground.heading
    places, headings = [base], [heading]
    for x, y, yaw in velocities:
        base += complex(x, y) * heading * TICK
        heading *= cmath.rect(1.0, yaw * TICK)
        places.append(base)
        headings.append(heading)
    return np.array(places), np.array(headings)


def test_behind_the_object_it_goes_straight_ahead_and_stops_where_the_object_is_at_its_goal():
    velocities = walk(BEHIND, GAIT, LONG)
    assert velocities[:, 1:] == pytest.approx(0.0, abs=1e-12)
    assert velocities[:120, 0] == pytest.approx(0.7)  # 1.7 m of the 2.75 to go
    places, _ = path(BEHIND, velocities)
    assert places[-1] == pytest.approx(2.0 - 0.25 - 0.5, abs=0.02)
    assert (np.diff(velocities[:, 0]) <= 1e-12).all()


@pytest.mark.parametrize("degrees", [1, 30, 90, 150, 165, -1, -60, -120, -165])
def test_from_any_side_it_comes_behind_the_object_at_a_distance_and_then_pushes(degrees):
    ground = replace(BEHIND, base=1.5 * cmath.rect(1.0, np.radians(degrees)))
    places, headings = path(ground, walk(ground, GAIT, LONG))
    pushing = np.argmax((places.real < 0.0) & (np.abs(places.imag) <= 0.125))
    assert pushing > 0
    assert np.abs(places[:pushing]).min() > 0.98 * ground.keep
    side = np.sign(places[:pushing].imag)
    assert (side == np.sign(degrees)).all()  # the shorter way round
    assert places[-1] == pytest.approx(1.25, abs=0.02)
    assert headings[-1] == pytest.approx(1.0, abs=0.01)  # it faces where the object goes


def test_it_goes_round_no_further_than_it_has_to():
    """From straight ahead: a tangent, half of the circle but for that, and the way to behind."""
    ground = replace(BEHIND, base=1.5 + 1e-9j)
    places, _ = path(ground, walk(ground, GAIT, LONG))
    pushing = int(np.argmax((places.real < 0.0) & (np.abs(places.imag) <= 0.125)))
    off = np.arccos(0.85 / 1.5)
    shortest = 1.5 * np.sin(off) + 0.85 * (np.pi - off - np.arcsin(0.125 / 0.85))
    assert np.abs(np.diff(places[: pushing + 1])).sum() == pytest.approx(shortest, rel=0.03)


def test_what_is_mirrored_or_turned_gives_the_same_walk():
    ground = replace(BEHIND, base=1.0 + 0.8j, heading=cmath.rect(1.0, 2.0))
    velocities = walk(ground, GAIT, LONG)
    flipped = replace(ground, base=ground.base.conjugate(), heading=ground.heading.conjugate())
    assert walk(flipped, GAIT, LONG) == pytest.approx(velocities * [1, -1, -1])
    turn, there = cmath.rect(1.0, 0.7), 3.0 - 2.0j
    turned = replace(
        ground,
        base=ground.base * turn + there,
        heading=ground.heading * turn,
        centre=there,
        way=ground.way * turn,
    )
    assert walk(turned, GAIT, LONG) == pytest.approx(velocities, abs=1e-6)


@pytest.mark.parametrize("upper", [(0.8, 0.4, 0.5), (0.5, 0.0, 0.3), (0.0, 0.0, 0.0)])
def test_every_velocity_stays_within_the_limits(upper):
    lower = (-0.2, -upper[1], -upper[2])
    ground = replace(BEHIND, base=1.0 + 0.8j)
    velocities = walk(ground, Gait(lower, upper, 0.5), LONG)
    assert (velocities <= np.array(upper) + 1e-12).all()
    assert (velocities >= np.array(lower) - 1e-12).all()


def test_a_base_beside_the_line_comes_onto_it_while_it_pushes():
    ground = replace(BEHIND, base=-1.0 + 0.1j)
    velocities = walk(ground, GAIT, LONG)
    places, _ = path(ground, velocities)
    assert velocities[0, 1] < 0.0
    assert abs(places[-1].imag) < 0.02


def test_too_near_the_object_it_first_steps_back():
    ground = replace(BEHIND, base=0.3 + 0.1j)
    places, _ = path(ground, walk(ground, GAIT, 100))
    assert np.abs(places[100]) > np.abs(places[0])


def test_an_object_at_its_goal_is_left_alone():
    assert not walk(replace(BEHIND, way=0.0j), GAIT, 75).any()
    assert not walk(replace(BEHIND, way=1e-4j), GAIT, 75).any()


@pytest.mark.parametrize("base", [0.0j, -0.75 + 0.0j, 0.85 + 0.0j, -2.75 + 0.0j])
def test_places_where_a_direction_is_lacking_are_no_trouble(base):
    assert np.isfinite(walk(replace(BEHIND, base=base), GAIT, 75)).all()
    assert np.isfinite(walk(replace(BEHIND, base=base, width=0.0, keep=0.0), GAIT, 75)).all()
