"""What is told of workers that do not answer, and of a machine that is busy."""

import itertools

import pytest

from sumo_dist.dispatch import busy, silences
from sumo_dist.dispatch.busy import BusyWatch
from sumo_dist.dispatch.silences import LINES, WINDOW_S, Silences
from sumo_dist.provenance import cores


@pytest.fixture
def told():
    return []


@pytest.fixture
def talk(told):
    return Silences(lambda level, text: told.append((level, text)), explained=lambda: False)


def test_the_first_silences_and_their_ends_are_told_at_once(talk, told):
    talk.began("w-1")
    talk.ended("w-1")
    assert told == [
        ("warning", "worker w-1 does not answer: it is passed over"),
        ("info", "worker w-1 answers again"),
    ]


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test puts forward."""
    now = [100.0]
    monkeypatch.setattr(silences.time, "monotonic", lambda: now[0])
    return now


def test_of_more_only_the_sum_is_told(talk, told, clock):
    for number in range(100):
        talk.began(f"w-{number % 6}")
        talk.ended(f"w-{number % 6}")
    talk.began("w-5")
    assert len(told) == 2 * LINES
    clock[0] += WINDOW_S
    talk.look()
    talk.look()
    level, text = told.pop()
    assert len(told) == 2 * LINES
    assert level == "warning"
    assert text.startswith(f"{101 - LINES} times in 30 s a worker did not answer: w-2 17, ")
    assert text.endswith(" and 2 more; silent now: w-5")


def test_where_it_is_known_why_only_sums_are_told_ever_more_seldom(told, clock):
    talk = Silences(lambda _, text: told.append(text), explained=lambda: True)
    for _ in range(3600):
        talk.began("w-1")
        talk.ended("w-1")
        clock[0] += 1.0
    assert len(told) <= 12
    assert "times in 30 s" in told[0]
    assert "times in 60 s" in told[1]
    assert "times in 480 s" in told[-1]


def test_after_a_quiet_window_the_next_silence_is_told_at_once_again(talk, told, clock):
    for _ in range(LINES):
        talk.began("w-1")
    clock[0] += WINDOW_S
    talk.began("w-2")
    assert told[-1] == ("warning", "worker w-2 does not answer: it is passed over")


def test_a_worker_that_has_left_is_not_silent(talk, told, clock):
    for name in ("w-1", "w-2", "w-3", "w-3"):
        talk.began(name)
    talk.left("w-3")
    talk.ended("w-3")
    clock[0] += WINDOW_S
    talk.look()
    assert "silent now: w-1, w-2" in told[-1][1]


def looks(monkeypatch, told, seen):
    """Look at (share of the cores that others use, slowdown), every time that is due."""
    clock = itertools.count(100.0, busy.PERIOD_S)
    monkeypatch.setattr(busy.time, "monotonic", lambda: next(clock))
    shares = iter([share for share, _ in seen])
    watch = BusyWatch(
        lambda level, text: told.append((level, text)), lambda: next(shares) * cores()
    )
    for _, slowdown in seen:
        watch.look(slowdown)


QUIET = [(0.1, 1.0)] * 8


@pytest.mark.parametrize("seen", [QUIET, [(0.1, 9.0)] * 8, [(0.5, 1.5)] * 8])
def test_nothing_is_told_where_one_explains_nothing(monkeypatch, told, seen):
    """Contacts alone make rollouts slow, and others may use a core that nobody misses."""
    looks(monkeypatch, told, seen)
    assert told == []


def test_others_that_slow_the_plans_down_are_told_once_and_so_is_their_end(monkeypatch, told):
    looks(monkeypatch, told, [*QUIET, *[(0.9, 8.0)] * 20, *QUIET])
    (level, text), end = told
    assert level == "warning"
    assert text == (
        "this machine is busy: plans take 8x their measured time (other programs use "
        f"{0.9 * cores():.1f} of {cores()} cores); workers give way to them unless the run has "
        "--no-give-way"
    )
    assert end == ("info", "this machine is not busy any more")


def test_what_comes_and_goes_is_told_every_half_minute_at_most(monkeypatch, told):
    looks(monkeypatch, told, [(0.9, 8.0), (0.0, 1.0)] * 60)  # ten minutes
    assert 2 <= len(told) <= 600 / busy.CALM_S + 1


def test_a_machine_that_does_not_tell_its_load_is_not_busy(told, monkeypatch):
    monkeypatch.setattr(busy, "PERIOD_S", 0.0)
    watch = BusyWatch(lambda *said: told.append(said), lambda: None)
    watch.look(50.0)
    assert told == []
