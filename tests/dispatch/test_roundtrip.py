import pytest

from sumo_dist.dispatch.roundtrip import MOST_S, SAMPLES, RoundTrip


def told(way, number, sent, seconds, held=0.07):
    """Let a plan go out, and be heard of after both ways and the robot's hold."""
    way.sent(number, sent)
    way.heard(number, held, sent + seconds + held)


def test_it_is_both_ways_without_the_time_the_robot_held_it():
    way = RoundTrip()
    assert way.seconds == 0.0
    for number in range(20):
        told(way, number, 100.0 + number, 0.04, held=0.01 * number)
    assert way.seconds == pytest.approx(0.04)


@pytest.mark.parametrize("lie", [0.0, -1e9, 1e9])
def test_a_few_lies_among_many_change_nothing(lie):
    way = RoundTrip()
    for number in range(3 * SAMPLES):
        told(way, number, float(number), lie if number % 3 == 0 else 0.04)
    assert way.seconds == pytest.approx(0.04)


def test_who_always_lies_is_believed_up_to_a_limit():
    way = RoundTrip()
    for number in range(SAMPLES):
        told(way, number, float(number), 1e9)
    assert way.seconds == MOST_S


def test_a_plan_counts_once_and_one_of_others_not_at_all():
    way = RoundTrip()
    told(way, 1, 5.0, 0.04)
    for _ in range(SAMPLES):
        way.heard(1, 0.0, 5.3)
        way.heard(77, 0.0, 6.0)
    assert way.seconds == pytest.approx(0.04)
