"""Workers that several robots share."""

import signal
import subprocess
import sys
from contextlib import ExitStack

import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.episode.summary import read_summary
from sumo_dist.launch import serve
from sumo_dist.launch.launcher import Launcher, Service
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.tasks import load_task

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

ROBOTS = {"spot": "spot/move_box", "g1": "g1/box_push", "spot-2": "spot/upright_cone"}
SETTINGS = ("rollouts=6", "horizon=0.4")


@pytest.fixture
def pool(endpoint):
    """A router and two workers, before any robot is there."""
    with Launcher() as launcher:
        launcher.start(Service("router", "router", serve.Router(endpoint)))
        for name in ("w-1", "w-2"):
            options = serve.Worker(connect=endpoint, name=name)
            launcher.start(Service(name, "rollout-worker", options))
        yield endpoint


def test_three_robots_share_two_workers_and_each_has_the_bits_of_one_that_is_alone(pool, tmp_path):
    with ExitStack() as stack:
        runs = {}
        for robot, task in ROBOTS.items():
            command = [
                *(sys.executable, "-P", "-m", "sumo_dist", "run", task, "--connect", pool),
                *("--robot", robot, "--seed", "1", "--time-limit", "0.6", "--viewer", "none"),
                *("--out", str(tmp_path / robot)),
                *(word for setting in SETTINGS for word in ("--set", setting)),
            ]
            runs[robot] = stack.enter_context(subprocess.Popen(command))
        for run in runs.values():
            assert run.wait(150.0) == 1  # out of time
    for robot, task in ROBOTS.items():
        summary = read_summary(tmp_path / robot)
        planner = PlannerConfig.resolve(load_task(task).planner, settings=SETTINGS)
        alone, _ = run_single(EpisodeConfig(task, 1, planner, time_limit=0.6), threads=1)
        assert summary["plan_digest"] == alone.plan_digest
        assert summary["state_digest"] == alone.state_digest


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_a_worker_that_is_told_to_end_loses_no_plan(
    run_system, expected_digests, eventually, clock
):
    """It says so, answers what it was asked, and ends well; nobody else is told anything."""
    pace = {"time_limit": 1.0} if clock == "lockstep" else {"speed": 0.05, "time_limit": 60.0}
    system = run_system(workers=2, clock=clock, **pace)
    system.after_plan(4)
    process = system.processes["local-0"]
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
