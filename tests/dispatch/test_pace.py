import pytest

from sumo_dist.dispatch.pace import FORGET_S, SAMPLES, Pace, Turnaround


@pytest.fixture
def turnaround():
    """One whose first answer, which may have waited for the task's compilation, has come."""
    measured = Turnaround()
    measured.asked(0, 0, -1.0)
    measured.answered(0, 5.0, -0.5)
    return measured


def test_rows_are_ready_after_the_wait_and_in_full_threads():
    pace = Pace(rows_per_ms=0.5, wait_ms=10.0, threads=4)
    assert [pace.ready_ms(rows) for rows in (1, 4, 5)] == [18.0, 18.0, 26.0]
    assert pace.rows_in(30.0) == 10.0
    assert pace.rows_in(5.0) == 0.0


def test_the_first_answer_does_not_count(turnaround):
    assert turnaround.wait_ms == 0.0
    turnaround.restart()
    turnaround.asked(1, 1, 0.0)
    turnaround.answered(1, 5.0, 0.5)
    assert turnaround.wait_ms == 0.0


def test_what_a_worker_computes_for_the_plan_is_no_wait(turnaround):
    for shard in (1, 2, 3):
        turnaround.asked(1, shard, 0.0)
    for shard, at in ((1, 0.050), (2, 0.060), (3, 0.070)):  # 10 ms each, after 40 on the way
        turnaround.answered(shard, 10.0, at)
        assert turnaround.wait_ms == pytest.approx(40.0)


def test_work_for_others_in_between_is_one(turnaround):
    turnaround.asked(1, 1, 0.0)
    turnaround.asked(1, 2, 0.0)
    turnaround.answered(1, 10.0, 0.010)
    turnaround.answered(2, 10.0, 0.120)
    assert turnaround.wait_ms == pytest.approx(50.0)  # of two, 0 and 100


def test_a_late_answer_is_of_the_plan_that_it_was_asked_for(turnaround):
    turnaround.asked(1, 1, 0.0)
    turnaround.asked(2, 2, 0.05)
    turnaround.answered(1, 10.0, 0.08)
    assert turnaround.wait_ms == pytest.approx(70.0)


def test_an_answer_counts_once_and_old_questions_are_forgotten(turnaround):
    turnaround.asked(1, 1, 0.0)
    turnaround.answered(1, 10.0, 0.02)
    turnaround.answered(1, 10.0, 9.0)
    assert turnaround.wait_ms == pytest.approx(10.0)
    turnaround.asked(2, 2, 0.1)
    turnaround.asked(3, 3, 0.2 + FORGET_S)
    turnaround.answered(2, 10.0, 0.3 + FORGET_S)
    assert turnaround.wait_ms == pytest.approx(10.0)


def wait(turnaround, number, ms):
    """Let a plan's only answer take some time beside its rollouts."""
    turnaround.asked(number, number, float(number))
    turnaround.answered(number, 0.0, number + ms * 1e-3)


def test_one_answer_that_is_held_up_changes_nothing_and_a_link_that_is_slow_soon_shows(turnaround):
    for number in range(1, 4):
        wait(turnaround, number, 2.0)
    wait(turnaround, 4, 500.0)
    assert turnaround.wait_ms == pytest.approx(2.0)
    for number in range(5, 5 + SAMPLES // 2):
        wait(turnaround, number, 40.0)
    assert turnaround.wait_ms == pytest.approx(40.0)
