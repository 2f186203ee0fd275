import itertools
import queue
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache

import pytest

from sumo_dist.episode.again import repeat
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.episode.summary import read_summary
from sumo_dist.launch.deployment import Deployment, services
from sumo_dist.launch.launcher import Launcher, Service, flags
from sumo_dist.launch.serve import Router
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.record.recording import Recording
from sumo_dist.tasks import load_task
from sumo_dist.timing import anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import WORKER
from sumo_dist.wire.messages import EpisodeEnd, EpisodeInfo, PlanMessage
from sumo_dist.wire.notices import Ack, CommandMessage, Event

# Noise so low that the robot stands, and its run goes on, for as long as a test needs it: with the
# usual noise, knots a tenth of a second apart throw the arm as fast as the guard allows, and a run
# in realtime may end by its fault.
QUICK = PlannerConfig(rollouts=10, horizon=0.4, variance_first=0.01, variance_last=0.01)


@pytest.fixture(scope="session")
def config():
    return QUICK


@pytest.fixture(scope="session")
def problem(config):
    return Problem.build(load_task("spot/move_box"), planning_options(config))


class Commander:
    """Gives a robot commands over the bus, until it answers; see `ctl`."""

    def __init__(self, bus, sender="tester"):
        self._bus, self.sender = bus, sender
        self._answers = bus.inbox(Ack, sender)
        self._numbers = itertools.count()

    def __call__(self, verb, name="", value="", number=None):
        """Return the answer to a command."""
        number = next(self._numbers) if number is None else number
        message = CommandMessage("any", number, self.sender, verb, name, value)
        deadline = time.monotonic() + 30.0
        while time.monotonic() < deadline:
            self._bus.publish(message)
            try:
                ack = self._answers.get(timeout=0.2)
            except queue.Empty:
                continue
            if ack.number == number:
                return ack
        raise AssertionError(f"no answer to {verb} {name} {value}")


def _until(condition):
    deadline = time.monotonic() + 60.0
    while not (met := condition()) and time.monotonic() < deadline:
        time.sleep(0.005)
    return met


class System:
    """The services of a run as real processes, which a test may kill, stop and start again."""

    def __init__(self, launcher, bus, endpoint):
        self._launcher, self.bus, self.endpoint = launcher, bus, endpoint
        self.newest_plan = -1  # of the episode
        self.plans = 0  # that were published
        self.answered = 0  # rollouts that the newest of them rests on
        self.run_id = ""  # of the episode
        self.hash = ""  # of its task
        self.number = 0  # of the episode within its session
        self.episodes = 0  # that were announced, of all sessions
        self.endings = {}  # run -> how it ended, as it was said
        self.events = []  # (source, level, text)
        bus.subscribe(EpisodeInfo, self._on_episode)
        bus.subscribe(PlanMessage, self._on_plan)
        bus.subscribe(EpisodeEnd, lambda end: self.endings.update({end.run: end.reason}))
        bus.subscribe(Event, lambda e: self.events.append((e.source, e.level, e.text)))
        self.command = Commander(bus)
        self._members = bus.watch(WORKER)
        self._services = {}
        self._guests = set()  # names of those that were not there from the beginning
        self.processes = {}

    def start(self, service):
        self.take(service, self._launcher.start(service))

    def take(self, service, process):
        """Take over a service that runs."""
        self.know(service)
        self.processes[service.name] = process

    def know(self, service):
        """Take note of a service that is started later."""
        self._services[service.name] = service

    def options(self, name):
        return self._services[name].options

    def start_robot(self, **changes):
        """Start the robot with other options than it was to have."""
        service = self._services["robot-interface"]
        self.start(replace(service, options=replace(service.options, **changes)))

    def restart(self, name, pause=0.0):
        self.kill(name)
        time.sleep(pause)
        self.start_again(name)

    def start_again(self, name):
        self.start(self._services[name])

    def forget(self):
        """Know nothing of the robots before: what is seen from now on is of the next one."""
        self.run_id, self.number, self.newest_plan, self.episodes = "", 0, -1, 0
        self.endings.clear()
        self.events.clear()

    def mend(self):
        """End robot and guests, start again what else has ended, and wait for all workers."""
        for name in (self._guests | {"robot-interface"}) & self.processes.keys():
            self.kill(name)
        for name in self._guests:
            del self.processes[name], self._services[name]
        self._guests.clear()
        others = self._services.keys() - {"robot-interface"}
        ended = {name for name in others if self.processes[name].poll() is not None}
        assert _until(lambda: not self._workers_of(ended))  # whose tokens may be there for a moment
        for name in ended:
            self.start_again(name)
        workers = {name for name in others if name.startswith("local-")}
        assert _until(lambda: self._workers_of(workers) == workers)

    def _workers_of(self, names):
        return {member.id for member in self._members.now} & names

    @contextmanager
    def held(self):
        """Let no robot time pass: what is to happen in a run, such as a start, may take long."""
        assert self.command("pause").refusal == ""
        yield
        assert self.command("resume").refusal == ""

    def start_like(self, name, new_name, **changes):
        """Start a service beside one that runs, with other options; return its process."""
        service = self._services[name]
        options = replace(service.options, **changes)
        self._guests.add(new_name)
        self.start(replace(service, name=new_name, options=options))
        return self.processes[new_name]

    def replace_robot(self, preexec_fn):
        """Start the robot again, under conditions of its own."""
        self.kill("robot-interface")
        service = self._services["robot-interface"]
        command = [sys.executable, "-m", "sumo_dist", service.command, *flags(service.options)]
        self.processes["robot-interface"] = subprocess.Popen(command, preexec_fn=preexec_fn)  # noqa: PLW1509

    def kill(self, name):
        self.processes[name].kill()
        self.processes[name].wait()

    def signal(self, name, number):
        self.processes[name].send_signal(number)

    def _on_episode(self, info):
        if info.run != self.run_id:
            self.run_id, self.hash, self.number = info.run, info.task_hash, info.number
            self.newest_plan = -1
            self.episodes += 1

    def _on_plan(self, message):
        plan = message.plan
        if message.run == self.run_id and plan.tick == anchor_tick(plan.number):
            # not one of the calibration
            self.newest_plan = max(self.newest_plan, plan.number)
            self.plans += 1
            self.answered = int(message.finite.sum())

    def after_plan(self, number, episode=1):
        """Wait until a plan of an episode, or a later one, was published."""
        self._while(
            lambda: self.number < episode or self.newest_plan < number,
            f"plan {number} did not come",
        )

    def after_more_plans(self, count):
        """Wait until as many more plans were published, whatever their numbers."""
        end = self.plans + count
        self._while(lambda: self.plans < end, f"{count} more plans did not come")

    def _while(self, condition, complaint, timeout=60.0):
        deadline = time.monotonic() + timeout
        while condition():
            assert time.monotonic() < deadline, complaint
            assert self.processes["robot-interface"].poll() is None, "the robot has ended"
            time.sleep(0.002)

    def finish(self, timeout=60.0, episode=1):
        """Wait for the robot to end; return its exit code and the summary of an episode."""
        code = self.processes["robot-interface"].wait(timeout)
        return code, read_summary(self.folder(episode))

    def said(self, source, text):
        """Whether a service has told people something."""
        return any(who == source and text in line for who, _, line in self.events)

    def interrupt(self, episode=1):
        """End a run that has shown what it should, however long that took; return its summary."""
        self.signal("robot-interface", signal.SIGINT)
        code, summary = self.finish(episode=episode)
        assert (code, summary["end_reason"]) == (130, "interrupted")
        return summary

    def folder(self, episode=1):
        out = self._services["robot-interface"].options.out
        return out if episode == 1 else out / f"episode-{episode}"

    def recording(self, episode=1):
        return Recording.load(self.folder(episode) / "run.npz")


@pytest.fixture
def commander():
    """Return the class of those who give commands over a bus."""
    return Commander


@contextmanager
def systems(endpoint, out):
    """Yield a function that starts a run with quick plans, of spot/move_box by default."""
    with ExitStack() as stack:

        def run(
            workers=2,
            threads=1,
            speed=None,
            wait=20.0,
            worker_engine=None,
            task="spot/move_box",
            resume_wait=0.0,
            stay=False,
            viewer=None,
            starts_robot=True,
            trust=(),
            give_way=False,  # workers that did would starve beside the tests of another process
            **changes,
        ):
            episode = EpisodeConfig(task, **{"seed": 1, "planner": QUICK, **changes})
            deployment = Deployment(
                *(episode, workers, threads, out, viewer, speed, wait, resume_wait, stay),
                trust=trust,
                give_way=give_way,
            )
            launcher = stack.enter_context(Launcher())
            router = Service("router", "router", Router(endpoint))
            launched = launcher.start(router)
            robot = load_task(task).scene.robot.name
            bus = stack.enter_context(Bus.dial(endpoint, robot))
            system = System(launcher, bus, endpoint)
            system.take(router, launched)
            for service in services(deployment, endpoint):
                changed = worker_engine is not None and service.command == "rollout-worker"
                changes = {"engine": worker_engine} if changed else {}
                system.know(replace(service, options=replace(service.options, **changes)))
                if starts_robot or service.command != "robot-interface":
                    system.start_again(service.name)
            return system

        yield run


@pytest.fixture
def run_system(endpoint, tmp_path):
    with systems(endpoint, tmp_path) as run:
        yield run


@pytest.fixture(scope="package")
def standing(free_endpoint, tmp_path_factory):
    """Return a function: a task's services with two workers, which stand from test to test.

    They end with this folder's tests: those of others look for what runs on this machine.
    """
    with ExitStack() as stack:

        @cache
        def of_robot(task):
            folder = tmp_path_factory.mktemp("standing")
            run = stack.enter_context(systems(free_endpoint(), folder))
            return run(workers=2, task=task, starts_robot=False)

        tasks = {}  # robot -> the first task that it had here

        def standing(task):
            return of_robot(tasks.setdefault(load_task(task).scene.robot.name, task))

        yield standing


@pytest.fixture
def robot_starts(standing, tmp_path):
    """Return a function that starts a robot where services stand.

    What tests have ended is started again, and a robot that they have left is ended.
    """

    def robot_starts(
        task="spot/move_box", wait=20.0, stay=False, speed=None, resume_wait=0.0, **changes
    ):
        system = standing(task)
        system.mend()
        system.forget()
        episode = EpisodeConfig(task, **{"seed": 1, "planner": QUICK, **changes})
        how = {"wait": wait, "stay": stay, "speed": speed, "resume_wait": resume_wait}
        system.start_robot(episode=episode, out=tmp_path, **how)
        return system

    return robot_starts


@pytest.fixture(scope="module")
def paused(free_endpoint, tmp_path_factory):
    """A robot in lockstep that waits for commands, for tests that leave it as it is."""
    with systems(free_endpoint(), tmp_path_factory.mktemp("paused")) as run:
        system = run(workers=1, time_limit=60.0)
        system.after_plan(1)
        assert system.command("pause").refusal == ""
        yield system


def digests(recording):
    return recording.plan_digest, recording.state_digest


@pytest.fixture(scope="session")
def assert_repeats():
    """Return a function: a recorded episode, run again in one process, has the same bits."""

    def check(recording):
        assert digests(repeat(recording)) == digests(recording)

    return check


@pytest.fixture(scope="session")
def expected_digests():
    """Return a function: what one process makes of the same episode."""

    @cache
    def expected(
        optimizer=QUICK.optimizer,
        time_limit=1.0,
        estimator="truth",
        task="spot/move_box",
        guidance=QUICK.guidance,
        rate=QUICK.rate,
    ):
        planner = replace(QUICK, optimizer=optimizer, guidance=guidance, rate=rate)
        episode = EpisodeConfig(task, 1, planner, estimator=estimator, time_limit=time_limit)
        recording, _ = run_single(episode, threads=1)
        return digests(recording)

    return expected
