"""Lockstep over Zenoh: whatever happens to the services, the bits are those of one process."""

import signal
import time
from dataclasses import replace
from importlib.util import find_spec

import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.planner.learned import driving

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

LIMIT = 2.0  # robot time of the runs that something happens to [s]: 40 plans
MIDDLE = 12  # the plan after which it happens


def digests(summary):
    return summary["plan_digest"], summary["state_digest"]


@pytest.fixture(autouse=True)
def no_traceback(capfd):
    yield
    assert "Traceback" not in capfd.readouterr().err


def assert_same_bits(finished, expected):
    code, summary = finished
    assert (code, summary["end_reason"], summary["plans"]) == (1, "timeout", 20)
    assert digests(summary) == expected
    # a worker that is slow to compile is asked twice: that is no loss
    assert summary["partial_plans"] == summary["missed_deadlines"] == 0


@pytest.mark.parametrize(("change", "limit"), [({"guidance": "object"}, 1.0), ({"rate": 50}, 0.4)])
def test_two_workers_give_the_same_bits_with_other_settings(
    robot_starts, expected_digests, config, change, limit
):
    system = robot_starts(planner=replace(config, **change), time_limit=limit)
    assert_same_bits(system.finish(), expected_digests(time_limit=limit, **change))


def test_a_learned_policy_drives_by_workers_with_the_same_bits(robot_starts, config, policy_file):
    episode = EpisodeConfig(
        "spot/move_box", 1, config.changed(driving(policy_file)), time_limit=1.0
    )
    recording, _ = run_single(episode, threads=1)
    system = robot_starts(planner=episode.planner, time_limit=1.0)
    assert_same_bits(system.finish(), (recording.plan_digest, recording.state_digest))


def test_a_learned_policy_that_the_optimizer_has_not_ends_the_run(robot_starts, config):
    planner = replace(config, guidance="learned", policy="/none/policy.onnx")
    code, summary = robot_starts(planner=planner, time_limit=1.0).finish()
    assert code == 3
    assert summary["end_reason"] == (
        "fault: cannot read policy file /none/policy.onnx on this host: No such file or directory"
    )


def test_any_number_of_workers_with_threads_gives_the_same_bits(
    run_system, expected_digests, tmp_path
):
    system = run_system(workers=3, threads=2, time_limit=1.0)
    assert_same_bits(system.finish(), expected_digests())
    for name in ("local-1", "local-2"):
        system.kill(name)
    system.start_robot(out=tmp_path / "1")
    assert_same_bits(system.finish(), expected_digests())


def test_frozen_workers_that_come_back_change_nothing(robot_starts, expected_digests):
    system = robot_starts(time_limit=LIMIT)
    system.after_plan(MIDDLE)
    for name in ("local-0", "local-1"):
        system.signal(name, signal.SIGSTOP)
        system.after_more_plans(3)
        system.signal(name, signal.SIGCONT)
    _, summary = system.finish()
    assert digests(summary) == expected_digests(time_limit=LIMIT)
    assert summary["rollouts_lost"] > 0  # what the frozen one had was asked of the other


def test_workers_that_all_die_and_are_replaced_change_nothing(robot_starts, expected_digests):
    system = robot_starts(time_limit=LIMIT)
    system.after_plan(MIDDLE)
    system.kill("local-0")
    system.kill("local-1")
    time.sleep(0.3)
    system.restart("local-1")
    _, summary = system.finish()
    assert digests(summary) == expected_digests(time_limit=LIMIT)


def test_a_restarted_service_goes_on_where_the_last_one_ended(robot_starts, expected_digests):
    system = robot_starts(time_limit=LIMIT)
    for plan, name in ((MIDDLE, "optimizer"), (2 * MIDDLE, "state-estimator")):
        system.after_plan(plan)
        system.restart(name)
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    assert digests(summary) == expected_digests(time_limit=LIMIT)


def test_a_robot_that_is_started_again_needs_nothing_else_restarted(robot_starts, expected_digests):
    """Nor does anything stay of the run before in an estimator that filters."""
    system = robot_starts(time_limit=1.0, estimator="lowpass")
    system.after_plan(5)
    for _ in range(2):  # in the middle of a run, and after its end
        system.restart("robot-interface")
        code, summary = system.finish()
        assert (code, summary["end_reason"]) == (1, "timeout")
        assert digests(summary) == expected_digests(estimator="lowpass")


def test_without_workers_the_run_ends_with_a_reason(robot_starts):
    system = robot_starts(time_limit=LIMIT, wait=4.0)
    system.after_plan(MIDDLE)
    system.kill("local-0")
    system.kill("local-1")
    code, summary = system.finish()
    assert code == 3
    assert summary["end_reason"] == "fault: no answer to the request for a plan in 4 s"
    assert summary["success"] is False
    assert MIDDLE < summary["plans"] < 40


def test_without_an_estimator_the_run_ends_with_a_reason(robot_starts):
    system = robot_starts(time_limit=LIMIT, wait=4.0)
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


@pytest.mark.parametrize(
    ("task", "estimator"), [("g1/box_push", "lowpass"), ("g1/door_open", "truth")]
)
def test_g1_gives_the_same_bits_whatever_dies(robot_starts, expected_digests, task, estimator):
    """Another robot, policy and memory, and a door that no free joint carries."""
    system = robot_starts(task, estimator=estimator, time_limit=1.0)
    system.after_plan(MIDDLE // 2)
    system.kill("local-0")
    if estimator == "lowpass":
        system.restart("router")
        system.after_plan(MIDDLE)
        system.restart("optimizer")
    code, summary = system.finish()
    assert (code, summary["robot"], summary["plans"]) == (1, "g1", 20)
    assert digests(summary) == expected_digests(time_limit=1.0, task=task, estimator=estimator)
