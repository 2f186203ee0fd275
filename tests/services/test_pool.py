"""Workers that several robots share."""

import signal
import subprocess
import sys
from contextlib import ExitStack

import pytest

from sumo_dist.cli import main
from sumo_dist.episode.summary import read_summary
from sumo_dist.launch import serve
from sumo_dist.launch.launcher import Launcher, Service
from sumo_dist.record.recording import Recording
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import PlanMessage

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

ROBOTS = {"spot": "spot/move_box", "g1": "g1/box_push", "spot-2": "spot/upright_cone"}
# Noise in which a robot stands for as long as the others need to come.
SETTINGS = ("rollouts=6", "horizon=0.4", "variance_first=0.01", "variance_last=0.01")


@pytest.fixture
def pool(endpoint):
    """A router and two workers, before any robot is there."""
    with Launcher() as launcher:
        launcher.start(Service("router", "router", serve.Router(endpoint)))
        for name in ("w-1", "w-2"):
            options = serve.Worker(connect=endpoint, name=name)
            launcher.start(Service(name, "rollout-worker", options))
        yield endpoint


def test_three_robots_share_two_workers_and_a_stop_of_one_is_nothing_to_the_others(
    pool, tmp_path, eventually, assert_repeats
):
    """Each has the bits of one that is alone, for as long as it was let run."""
    with ExitStack() as stack:
        runs, plans = {}, {robot: set() for robot in ROBOTS}  # by number: some come twice
        for robot, task in ROBOTS.items():
            bus = stack.enter_context(Bus.dial(pool, robot, timeout=60.0))
            bus.subscribe(PlanMessage, lambda m, made=plans[robot]: made.add(m.plan.number))
            command = [
                *(sys.executable, "-P", "-m", "sumo_dist", "run", task, "--connect", pool),
                *("--robot", robot, "--seed", "1", "--time-limit", "3600", "--viewer", "none"),
                *("--out", str(tmp_path / robot)),
                *(word for setting in SETTINGS for word in ("--set", setting)),
            ]
            runs[robot] = stack.enter_context(subprocess.Popen(command))
        try:
            assert eventually(lambda: all(len(made) > 2 for made in plans.values()), 120.0)
            assert main(["stop", "--connect", pool, "--robot", "spot-2", "--reason", "a test"]) == 0
            assert runs["spot-2"].wait(60.0) == 3
            others = [robot for robot in ROBOTS if robot != "spot-2"]
            before = {robot: len(plans[robot]) for robot in others}
            assert eventually(lambda: all(len(plans[r]) > before[r] + 2 for r in others), 60.0)
        finally:
            for run in runs.values():
                run.send_signal(signal.SIGINT)
        assert [runs[robot].wait(60.0) for robot in others] == [130, 130]
    for robot in ROBOTS:
        recording = Recording.load(tmp_path / robot / "run.npz")
        assert_repeats(recording)
        verbs = [command["verb"] for command in recording.operator]
        assert verbs == (["stop"] if robot == "spot-2" else [])
        assert len(recording.plan_numbers) >= 2
    reason = read_summary(tmp_path / "spot-2")["end_reason"]
    assert reason.endswith(": a test, the robot sat down")


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_a_worker_that_is_told_to_end_loses_no_plan(
    run_system, expected_digests, eventually, clock
):
    """It says so, answers what it was asked, and ends well; nobody else is told anything."""
    pace = {"time_limit": 1.0} if clock == "lockstep" else {"speed": 0.1, "time_limit": 60.0}
    system = run_system(workers=2, clock=clock, **pace)
    system.after_plan(4)
    process = system.processes["local-0"]
    system.events.clear()  # on a busy machine it may have been slow to compile
    process.send_signal(signal.SIGTERM)
    assert process.wait(30.0) == 0
    if clock == "lockstep":
        assert system.finish(120.0)[0] == 1  # out of time
        recording = system.recording()
        assert (recording.plan_digest, recording.state_digest) == expected_digests()
    else:
        system.after_more_plans(2)
        assert eventually(lambda: system.answered > 0, 60.0)
        system.interrupt()
    assert not system.said("optimizer", "local-0 does not answer")
