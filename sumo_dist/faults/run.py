"""Runs a fault script on real processes and judges what it did to the run."""

import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.extras import need
from sumo_dist.faults.bridge import FaultBridge
from sumo_dist.faults.growth import GrowthMonitor
from sumo_dist.faults.occurrence import FaultOccurrence
from sumo_dist.faults.script import Fault, Script
from sumo_dist.faults.verdict import Outcome, RunRecord, episode_of, judge
from sumo_dist.launch import serve
from sumo_dist.launch.deployment import Deployment, services
from sumo_dist.launch.launcher import Launcher, Service
from sumo_dist.timing import anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import Member
from sumo_dist.wire.messages import EpisodeEnd, PlanMessage

TIMEOUT_S = 180.0  # of a whole run, beside twice the time it takes by its clock
START_S = 30.0  # a router is up by then, on a busy machine as well
ROUTERS = ("router", "far-router")
ROLES = {"state-estimator": "estimator", "robot-interface": "robot"}  # on the bus, by service


def run_script(script: Script, keep: Path | None = None) -> Outcome:
    """Run a script once and judge the run.

    Args:
        script: what to run.
        keep: folder for the run's files and the services' messages; thrown away by default.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with _stderr_to(folder / "messages.txt"), FaultRun(script, folder) as run:
            record = run.play()
        (folder / "growth.csv").write_text(run.growth.csv())
        outcome = judge(record, lambda: run_script(replace(script, faults=())).end)
        if keep is not None:
            shutil.copytree(folder, keep, dirs_exist_ok=True)
        return outcome


class FaultRun:
    """The processes of one run, and what is done to them. A context manager.

    Attributes:
        growth: sizes of the processes.
        near: endpoint of the router that the robot dials, unless it is behind the bridge.
    """

    def __init__(self, script: Script, folder: Path) -> None:
        """Prepare; entering starts everything."""
        self.growth, self.near = GrowthMonitor(), _free_endpoint()
        self._script, self._folder, self._stack = script, folder, ExitStack()
        self._rate = episode_of(script).planner.rate  # plans per second of robot time
        self._services: dict[str, Service] = {}
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._occurrences: list[FaultOccurrence] = []
        self._counts: Counter[str] = Counter()  # messages by what the bridge did to them
        self._newest_plan, self._good_plan_at, self._ended_at = -1, 0.0, None

    def __enter__(self) -> "FaultRun":
        with self._stack as stack:  # if a step fails, what was started before is closed
            self._start_all(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def play(self) -> RunRecord:
        """Let everything happen until the robot's process ends, or hangs."""
        todo = sorted(
            ((plan, f) for f in self._script.faults for plan in f.plans), key=lambda each: each[0]
        )
        timeout = TIMEOUT_S + 2.0 * self._script.time_limit / self._script.speed
        robot, deadline = self._running["robot-interface"], time.monotonic() + timeout
        active: list[tuple[float, FaultOccurrence]] = []  # until when
        while robot.poll() is None and time.monotonic() < deadline:
            now = time.monotonic()
            while todo and self._newest_plan >= todo[0][0]:
                occurrence = FaultOccurrence(todo.pop(0)[1], now)
                self._begin(occurrence)
                active.append((now + occurrence.fault.lasts, occurrence))
            for due in [each for each in active if each[0] <= now]:
                active.remove(due)
                self._end(due[1])
            self._note_recoveries()
            self.growth.sample(self._running)
            time.sleep(0.005)
        return RunRecord(
            *(self._script, self._folder, robot.poll(), self._occurrences),
            *(self.growth.growths(), dict(self._counts), self._ended_at),
        )

    def _start_all(self, stack: ExitStack) -> None:
        """Make what the faults need, then start routers, bridge and services."""
        script = self._script
        if script.viewer:
            need("view", f"the viewer of {script.name}")
        near, far = self.near, _free_endpoint()
        planned = planned_services(script, self._folder, near)
        self._launcher = stack.enter_context(Launcher())
        self._start(Service("router", "router", serve.Router(near)))
        if script.behind:
            self._start(Service("far-router", "router", serve.Router(far)))
            self._bridge = stack.enter_context(FaultBridge(near, far, script.seed))
            self._counts = self._bridge.counts
        bus = stack.enter_context(Bus.dial(near, "spot", timeout=START_S))
        self._alive = bus.watch()
        bus.subscribe(PlanMessage, self._on_plan)
        bus.subscribe(EpisodeEnd, self._on_run_end)
        for service in planned:
            endpoint = far if service.name in script.behind else near
            self._start(replace(service, options=replace(service.options, connect=endpoint)))

    def _start(self, service: Service) -> None:
        self._services[service.name] = service
        self._running[service.name] = self._launcher.start(service)

    def _begin(self, occurrence: FaultOccurrence) -> None:
        self._occurrences.append(occurrence)
        fault = occurrence.fault
        if fault.kind == "kill":
            self._running[fault.target].kill()
            self._running[fault.target].wait()
        elif fault.kind == "freeze":
            self._running[fault.target].send_signal(signal.SIGSTOP)
        else:
            self._set_bridge()

    def _end(self, occurrence: FaultOccurrence) -> None:
        fault = occurrence.fault
        if fault.kind == "kill":
            self._start(self._services[fault.target])
            return  # it ends when the service is alive again: see _note_recoveries
        occurrence.ended = time.monotonic()
        if fault.kind == "freeze":
            self._running[fault.target].send_signal(signal.SIGCONT)
        else:
            self._set_bridge()

    def _set_bridge(self) -> None:
        """Let the bridge do what the active faults of messages say."""
        active = [o.fault for o in self._occurrences if o.fault.is_message and o.ended is None]
        self._bridge.set_faults(*active)

    def _note_recoveries(self) -> None:
        """Note which killed services are alive again, and after which faults plans came."""
        for occurrence in self._occurrences:
            fault = occurrence.fault
            restarted = time.monotonic() > occurrence.began + fault.lasts
            if occurrence.ended is None and fault.kind == "kill" and restarted:
                occurrence.ended = time.monotonic() if self._is_alive(fault) else None
            if occurrence.ended is None or occurrence.resumed is not None:
                continue
            if self._good_plan_at >= occurrence.ended:
                occurrence.resumed = self._good_plan_at

    def _is_alive(self, fault: Fault) -> bool:
        if fault.target in ROUTERS:
            return _answers(self._services[fault.target].options.listen)
        return any(_is_member(member, fault.target) for member in self._alive.now)

    def _on_plan(self, message: PlanMessage) -> None:
        plan = message.plan
        anchor = anchor_tick(plan.number, self._rate)
        if plan.tick == anchor or self._script.clock == "lockstep":
            self._newest_plan = max(self._newest_plan, plan.number)
            if not message.failed:
                self._good_plan_at = time.monotonic()

    def _on_run_end(self, _message: EpisodeEnd) -> None:
        self._ended_at = self._ended_at or time.monotonic()


def planned_services(script: Script, out: Path, endpoint: str) -> list[Service]:
    """Return the services of a run.

    Raises:
        UsageError: the script names a service that is not among them.
    """
    speed = script.speed if script.clock == "realtime" else None
    run = episode_of(script), script.workers, 1, out, script.viewer or None
    deployment = Deployment(*run, speed, script.wait, give_way=script.give_way)
    planned = list(services(deployment, endpoint))
    names = [service.name for service in planned]
    checks = [(name, names) for name in script.behind]
    targets = [*names, "router"]
    checks += [(fault.target, targets) for fault in script.faults if not fault.is_message]
    for name, valid in checks:
        if name not in valid:
            raise UsageError(f"{script.name}: no service {name!r}; valid: {', '.join(valid)}")
    return planned


def _free_endpoint() -> str:
    """An endpoint below the ports that systems hand out to others between now and its use."""
    while True:
        port = int(np.random.default_rng().integers(15_000, 32_000))
        if not _answers(endpoint := f"tcp/127.0.0.1:{port}"):
            return endpoint


def _is_member(member: Member, service: str) -> bool:
    return member.role == ROLES.get(service, service) or member.id == service


def _answers(endpoint: str) -> bool:
    """Whether somebody listens on an endpoint of this machine."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    with socket.socket() as probe:
        probe.settimeout(0.1)
        return probe.connect_ex((host, int(port))) == 0


@contextmanager
def _stderr_to(path: Path) -> Iterator[None]:
    """Send what this process and its children write to stderr to a file."""
    saved = os.dup(2)
    try:
        with path.open("wb") as file:
            os.dup2(file.fileno(), 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
