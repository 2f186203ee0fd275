"""Lockstep over Zenoh: whatever happens to the services, the bits are those of one process."""

import signal
import time
from dataclasses import replace
from importlib.util import find_spec

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

LIMIT = 2.0  # robot time of the runs that something happens to [s]: 40 plans
MIDDLE = 12  # the plan after which it happens


def digests(summary):
    return summary["plan_digest"], summary["state_digest"]


@pytest.fixture(autouse=True)
def no_traceback(capfd):
    yield
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize(
    ("workers", "threads", "optimizer", "guidance"),
    [
        (1, 1, "cem", "none"),
        (1, 2, "mppi", "none"),
        (2, 1, "ps", "object"),
        (2, 2, "cem", "none"),
        (5, 2, "cem", "none"),
    ],
)
def test_any_number_of_workers_and_threads_gives_the_same_bits(
    run_system, expected_digests, config, workers, threads, optimizer, guidance
):
    planner = replace(config, optimizer=optimizer, guidance=guidance)
    code, summary = run_system(workers, threads, planner=planner, time_limit=1.0).finish()
    assert (code, summary["end_reason"], summary["plans"]) == (1, "timeout", 20)
    assert digests(summary) == expected_digests(optimizer, guidance=guidance)
    # a worker that is slow to compile is asked twice: that is no loss
    assert summary["partial_plans"] == summary["missed_deadlines"] == 0


def test_a_killed_worker_changes_nothing(run_system, expected_digests):
    system = run_system(workers=2, time_limit=LIMIT)
    system.after_plan(MIDDLE)
    system.kill("local-0")
    code, summary = system.finish()
    assert code == 1
    assert digests(summary) == expected_digests(time_limit=LIMIT)


def test_a_frozen_worker_that_comes_back_changes_nothing(run_system, expected_digests):
    system = run_system(workers=2, time_limit=LIMIT)
    system.after_plan(MIDDLE)
    system.signal("local-0", signal.SIGSTOP)
    system.after_plan(MIDDLE + 3)
    system.signal("local-0", signal.SIGCONT)
    _, summary = system.finish()
    assert digests(summary) == expected_digests(time_limit=LIMIT)
    assert summary["rollouts_lost"] > 0  # what the frozen one had was asked of the other


def test_workers_that_all_die_and_are_replaced_change_nothing(run_system, expected_digests):
    system = run_system(workers=2, time_limit=LIMIT)
    system.after_plan(MIDDLE)
    system.kill("local-0")
    system.kill("local-1")
    time.sleep(0.3)
    system.restart("local-1")
    _, summary = system.finish()
    assert digests(summary) == expected_digests(time_limit=LIMIT)


@pytest.mark.parametrize("name", ["optimizer", "state-estimator"])
def test_a_restarted_service_goes_on_where_the_last_one_ended(run_system, expected_digests, name):
    system = run_system(workers=2, time_limit=LIMIT)
    system.after_plan(MIDDLE)
    system.restart(name)
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    assert digests(summary) == expected_digests(time_limit=LIMIT)


@pytest.mark.parametrize("estimator", ["truth", "lowpass"])
def test_a_robot_that_is_started_again_needs_nothing_else_restarted(
    run_system, expected_digests, estimator
):
    system = run_system(workers=1, time_limit=1.0, estimator=estimator)
    system.after_plan(5)
    for _ in range(2):  # in the middle of a run, and after its end
        system.restart("robot-interface")
        _, summary = system.finish()
        assert digests(summary) == expected_digests(estimator=estimator)


def test_without_workers_the_run_ends_with_a_reason(run_system):
    system = run_system(workers=1, time_limit=LIMIT, wait=4.0)
    system.after_plan(MIDDLE)
    system.kill("local-0")
    code, summary = system.finish()
    assert code == 3
    assert summary["end_reason"] == "fault: no answer to the request for a plan in 4 s"
    assert summary["success"] is False
    assert MIDDLE < summary["plans"] < 40


def test_without_an_estimator_the_run_ends_with_a_reason(run_system):
    system = run_system(workers=1, time_limit=LIMIT, wait=4.0)
    system.after_plan(MIDDLE)
    system.kill("state-estimator")
    code, summary = system.finish()
    assert code == 3
    assert summary["end_reason"] == "fault: no answer to the request for a state in 4 s"


@pytest.mark.skipif(find_spec("sumo_dist.rollout._native") is None, reason="not compiled here")
def test_a_worker_of_another_build_is_told_on_both_sides_and_goes_on(run_system, capfd):
    system = run_system(workers=1, time_limit=0.5, wait=3.0, worker_engine="native-portable")
    code, summary = system.finish()
    assert code == 3
    assert summary["end_reason"] == "fault: no answer to the request for a plan in 3 s"
    assert system.processes["local-0"].poll() is None  # others may need it
    err = capfd.readouterr().err
    assert "worker local-0 is left out: its build is " in err
    assert "cannot be served: its build is " in err
    remedy = "if only the instruction sets differ, give all of them --engine native-portable"
    assert err.count(remedy) == 2


def test_lowpass_estimates_are_the_same_over_zenoh(run_system, expected_digests):
    code, summary = run_system(estimator="lowpass", time_limit=0.5).finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    assert digests(summary) == expected_digests(estimator="lowpass", time_limit=0.5)


@pytest.mark.parametrize("task", ["g1/box_push", "g1/door_open"])
def test_g1_gives_the_same_bits_though_a_worker_dies(run_system, expected_digests, task):
    """Another robot, policy and memory, and a door that no free joint carries."""
    system = run_system(workers=2, time_limit=1.0, task=task)
    system.after_plan(MIDDLE // 2)
    system.kill("local-0")
    code, summary = system.finish()
    assert (code, summary["robot"], summary["plans"]) == (1, "g1", 20)
    assert digests(summary) == expected_digests(time_limit=1.0, task=task)


def test_g1_on_lowpass_estimates_gives_the_same_bits(run_system, expected_digests):
    system = run_system(estimator="lowpass", time_limit=0.5, task="g1/box_push")
    _, summary = system.finish()
    expected = expected_digests(estimator="lowpass", time_limit=0.5, task="g1/box_push")
    assert digests(summary) == expected
