"""How an episode ended, in words and as an exit code."""

import pytest

from sumo_dist.episode.ending import End, Ending, fault

ENDINGS = [
    (Ending(End.SUCCESS), "success", 0),
    (Ending(End.FELL), "fell", 1),
    (Ending(End.TIMEOUT), "timeout", 1),
    (Ending(End.FAILURE, "tipped"), "tipped", 1),
    (Ending(End.REPLACED, "reset by ann"), "replaced: reset by ann", 1),
    (Ending(End.STOPPED, "ann: a dog"), "stopped by ann: a dog", 3),
    (fault("no answer to the request for a plan in 60 s"), "fault: no answer to the request", 3),
    (Ending(End.INTERRUPTED), "interrupted", 130),
]


@pytest.mark.parametrize(("ending", "reason", "code"), ENDINGS)
def test_words_and_exit_code(ending, reason, code):
    assert ending.reason.startswith(reason)
    assert ending.exit_code == code
    assert ending.success is (code == 0)


def test_every_kind_is_told_apart():
    assert {ending.kind for ending, _, _ in ENDINGS} == set(End)
    assert len({ending.reason for ending, _, _ in ENDINGS}) == len(End)


@pytest.mark.parametrize(("ending", "reason", "code"), ENDINGS)
def test_a_robot_that_sat_down_has_ended_in_the_same_way(ending, reason, code):
    sat = Ending(ending.kind, ending.detail, sat_down=True)
    assert sat.reason == f"{ending.reason}, the robot sat down"
    assert sat.exit_code == code


def test_the_time_it_took_is_no_part_of_what_it_was():
    ending = Ending(End.STOPPED, "ann", sat_down=True).after(2.5)
    assert ending.wall_s == 2.5
    assert ending == Ending(End.STOPPED, "ann", True, 2.5)
    assert ending.reason == "stopped by ann, the robot sat down"


def test_a_fault_is_named_by_anything():
    assert fault(ValueError("it broke")).detail == "it broke"
