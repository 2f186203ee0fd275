import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import replace
from functools import cache

import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.episode.summary import read_summary
from sumo_dist.launch.deployment import Crew, services
from sumo_dist.launch.launcher import Launcher, Service, flags
from sumo_dist.launch.serve import Router
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.record.recording import Recording
from sumo_dist.tasks import load_task
from sumo_dist.timing import anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import PlanMessage

QUICK = PlannerConfig(rollouts=10, horizon=0.4)


@pytest.fixture(scope="session")
def config():
    return QUICK


@pytest.fixture(scope="session")
def problem(config):
    return Problem.build(load_task("spot/move_box"), planning_options(config))


class System:
    """The services of a run as real processes, which a test may kill, stop and start again."""

    def __init__(self, launcher, bus, out):
        self._launcher, self._out = launcher, out
        self.newest_plan = -1
        self.plans = 0  # that were published
        self.answered = 0  # rollouts that the newest of them rests on
        bus.subscribe(PlanMessage, self._on_plan)
        self._services = {}
        self.processes = {}

    def start(self, service):
        self.take(service, self._launcher.start(service))

    def take(self, service, process):
        """Take over a service that runs."""
        self._services[service.name] = service
        self.processes[service.name] = process

    def restart(self, name, pause=0.0):
        self.kill(name)
        time.sleep(pause)
        self.start_again(name)

    def start_again(self, name):
        self.start(self._services[name])

    def replace_robot(self, preexec_fn):
        """Start the robot again, under conditions of its own."""
        self.kill("robot-interface")
        service = self._services["robot-interface"]
        command = [sys.executable, "-m", "sumo_dist", service.command, *flags(service.options)]
        self.processes["robot-interface"] = subprocess.Popen(command, preexec_fn=preexec_fn)  # noqa: PLW1509

    @property
    def run_id(self):
        return self._services["robot-interface"].options.run

    def kill(self, name):
        self.processes[name].kill()
        self.processes[name].wait()

    def signal(self, name, number):
        self.processes[name].send_signal(number)

    def _on_plan(self, message):
        plan = message.plan
        if plan.tick == anchor_tick(plan.number):  # not one of the calibration
            self.newest_plan = max(self.newest_plan, plan.number)
            self.plans += 1
            self.answered = int(message.finite.sum())

    def after_plan(self, number):
        """Wait until a plan of the run, or a later one, was published."""
        self._while(lambda: self.newest_plan < number, f"plan {number} did not come")

    def after_more_plans(self, count):
        """Wait until as many more plans were published, whatever their numbers."""
        end = self.plans + count
        self._while(lambda: self.plans < end, f"{count} more plans did not come")

    def _while(self, condition, complaint, timeout=30.0):
        deadline = time.monotonic() + timeout
        while condition():
            assert time.monotonic() < deadline, complaint
            assert self.processes["robot-interface"].poll() is None, "the robot has ended"
            time.sleep(0.002)

    def finish(self, timeout=60.0):
        """Wait for the robot to end; return its exit code and the summary."""
        code = self.processes["robot-interface"].wait(timeout)
        return code, read_summary(self._out)

    def interrupt(self):
        """End a run that has shown what it should, however long that took; return its summary."""
        self.signal("robot-interface", signal.SIGINT)
        code, summary = self.finish()
        assert (code, summary["end_reason"]) == (130, "interrupted")
        return summary

    def recording(self):
        return Recording.load(self._out / "run.npz")


@pytest.fixture
def run_system(endpoint, tmp_path):
    """Return a function that starts a run with quick plans, of spot/move_box by default."""
    with ExitStack() as stack:

        def run(
            workers=2,
            threads=1,
            speed=None,
            wait=20.0,
            worker_engine="auto",
            task="spot/move_box",
            resume_wait=0.0,
            **changes,
        ):
            episode = EpisodeConfig(task, **{"seed": 1, "planner": QUICK, **changes})
            crew = Crew(episode, workers, threads, tmp_path, None, speed, wait, resume_wait)
            launcher = stack.enter_context(Launcher())
            router = Service("router", "router", Router(endpoint))
            launched = launcher.start(router)
            bus = stack.enter_context(Bus.dial(endpoint, task.partition("/")[0]))
            system = System(launcher, bus, tmp_path)
            system.take(router, launched)
            for service in services(crew, endpoint):
                changes = {"engine": worker_engine} if service.command == "rollout-worker" else {}
                system.start(replace(service, options=replace(service.options, **changes)))
            return system

        yield run


@pytest.fixture(scope="session")
def expected_digests():
    """Return a function: what one process makes of the same episode."""

    @cache
    def digests(optimizer="cem", time_limit=1.0, estimator="truth", task="spot/move_box"):
        planner = replace(QUICK, optimizer=optimizer)
        episode = EpisodeConfig(task, 1, planner, estimator=estimator, time_limit=time_limit)
        recording, _ = run_single(episode, threads=1)
        return recording.plan_digest, recording.state_digest

    return digests
