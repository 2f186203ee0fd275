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
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.faults.bridge import Mangler
from sumo_dist.faults.clock import WallClock
from sumo_dist.faults.growth import Census
from sumo_dist.faults.netns import Cable
from sumo_dist.faults.occurrence import Blow
from sumo_dist.faults.processes import (
    check_disks_can_fill,
    children,
    fill_disk,
    free_disk,
    kill_children,
)
from sumo_dist.faults.script import VIEWER, Script
from sumo_dist.faults.verdict import Outcome, episode_of, judge
from sumo_dist.launch import serve
from sumo_dist.launch.deployment import Crew, services
from sumo_dist.launch.launcher import Launcher, Service
from sumo_dist.timing import anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import Member
from sumo_dist.wire.messages import PlanMessage, RunEnd

PATIENCE_S = 180.0  # for a whole run, beside twice the time it takes by its clock
START_S = 30.0  # a router is up by then, on a busy machine as well
VIEWER_S = 0.1  # between two looks for a viewer that is to be killed
ROUTERS = ("router", "far-router")


def play(script: Script, keep: Path | None = None) -> Outcome:
    """Run a script once.

    Args:
        script: what to run.
        keep: folder for the run's files and the services' messages; thrown away by default.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        with _stderr_to(out / "messages.txt"), Stage(script, out) as stage:
            code = stage.run()
        growths = tuple(stage.census.growths())
        (out / "census.csv").write_text(stage.census.table())
        outcome = judge(
            *(script, stage.blows, code, out, growths, dict(stage.mangled)),
            *(stage.over, lambda: play(replace(script, faults=())).end),
        )
        if keep is not None:
            shutil.copytree(out, keep, dirs_exist_ok=True)
        return outcome


class Stage:
    """The processes of one run, and what is done to them."""

    def __init__(self, script: Script, out: Path) -> None:
        """Prepare; entering starts everything."""
        self._script, self._out, self._stack = script, out, ExitStack()
        self._services: dict[str, Service] = {}
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._newest, self._good = -1, 0.0  # number and arrival of plans
        self.blows: list[Blow] = []
        self._wall: WallClock | None = None
        self._cable: Cable | None = None
        self._looked = 0.0  # for a viewer
        self.over: float | None = None  # when the robot said that the run is over
        self.census = Census()
        self.mangled: Counter[str] = Counter()

    def __enter__(self) -> "Stage":
        try:
            return self._entered()
        except BaseException:
            self._stack.close()  # what was started by then
            raise

    def _entered(self) -> "Stage":
        host = self._prepare()
        near, far = _free_endpoint(host), _free_endpoint()
        planned = self._planned(near)
        self._launcher = self._stack.enter_context(Launcher())
        self._start(Service("router", "router", serve.Router(near)))
        if self._script.behind:
            self._start(Service("far-router", "router", serve.Router(far)))
            self._mangler = self._stack.enter_context(Mangler(near, far, self._script.seed))
            self.mangled = self._mangler.done
        self._bus = self._stack.enter_context(Bus.dial(near, "spot", timeout=START_S))
        self._alive = self._bus.watch()
        self._bus.subscribe(PlanMessage, self._on_plan)
        self._bus.subscribe(RunEnd, self._on_end)
        for service in planned:
            behind = service.name in self._script.behind
            options = replace(service.options, connect=far) if behind else service.options
            apart = self._cable.prefix if self._cable and service.name in self._script.apart else ()
            self._start(replace(service, options=options, prefix=apart))
        return self

    def _prepare(self) -> str:
        """Make what the faults need; return the address that all services reach.

        Raises:
            UsageError: this machine or this user cannot make it.
        """
        script, kinds = self._script, {fault.kind for fault in self._script.faults}
        if script.viewer and find_spec("rerun") is None:
            raise UsageError(f"{script.name} has a viewer: pip install 'sumo-dist[view]'")
        if "disk" in kinds:
            check_disks_can_fill()
        if "clock" in kinds:
            self._wall = self._stack.enter_context(WallClock())
        if script.apart:
            self._cable = self._stack.enter_context(Cable())
            return self._cable.host
        return "127.0.0.1"

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _planned(self, endpoint: str) -> list[Service]:
        """Services of the run; raises, before any is started, if the script names another."""
        script = self._script
        speed = script.speed if script.clock == "realtime" else None
        run = episode_of(script), script.workers, 1, self._out, script.viewer or None
        crew = Crew(*run, speed, script.wait)
        planned = list(services(crew, endpoint))
        valid = [service.name for service in planned]
        targets = [*valid, "router", *([VIEWER] if script.viewer else [])]
        placed = [(name, valid) for name in (*script.behind, *script.apart)]
        for name, valid in (*placed, *((f.target, targets) for f in script.faults if f.is_process)):
            if name not in valid:
                raise UsageError(f"{script.name}: no service {name!r}; valid: {', '.join(valid)}")
        return planned

    def run(self) -> int | None:
        """Let everything happen; return the robot's exit code, None if it hangs."""
        todo = sorted(
            ((plan, f) for f in self._script.faults for plan in f.plans), key=lambda each: each[0]
        )
        patience = PATIENCE_S + 2.0 * self._script.time_limit / self._script.speed
        robot, deadline = self._running["robot-interface"], time.monotonic() + patience
        over: list[tuple[float, Blow]] = []  # when to end what has begun
        while robot.poll() is None:
            if time.monotonic() > deadline:
                return None
            now = time.monotonic()
            while todo and self._newest >= todo[0][0] and self._is_there(todo[0][1].target):
                blow = Blow(todo.pop(0)[1], now)
                self._begin(blow)
                over.append((now + blow.fault.lasts, blow))
                self.blows.append(blow)
            for due, blow in [each for each in over if each[0] <= now]:
                over.remove((due, blow))
                self._end(blow)
            self._follow()
            self.census.look(self._running)
            time.sleep(0.005)
        return robot.returncode

    def _start(self, service: Service) -> None:
        self._services[service.name] = service
        wall = self._wall.prefix if self._wall else ()
        dressed = replace(service, prefix=(*service.prefix, *wall))
        self._running[service.name] = self._launcher.start(dressed)

    def _is_there(self, target: str) -> bool:
        """Whether a fault has something to happen to: a viewer opens after all services."""
        if target != VIEWER:
            return True
        if time.monotonic() < self._looked + VIEWER_S:
            return False
        self._looked = time.monotonic()
        return bool(children(self._running["tracer"].pid))

    def _begin(self, blow: Blow) -> None:
        fault = blow.fault
        match fault.kind:
            case "kill" if fault.target == VIEWER:
                kill_children(self._running["tracer"].pid)
            case "kill":
                self._running[fault.target].kill()
                self._running[fault.target].wait()
            case "freeze":
                self._running[fault.target].send_signal(signal.SIGSTOP)
            case "disk":
                fill_disk(self._running[fault.target].pid)
            case "clock" if self._wall:
                self._wall.jump(fault.jump_s)
            case "unplug" if self._cable:
                self._cable.unplug()
            case _:
                self._set_rules(adding=blow)

    def _end(self, blow: Blow) -> None:
        fault = blow.fault
        match fault.kind:
            case "kill" if fault.target != VIEWER:
                self._start(self._services[fault.target])
                return  # it is over once the service is there again: see _follow
            case "freeze":
                self._running[fault.target].send_signal(signal.SIGCONT)
            case "disk":
                free_disk(self._running[fault.target].pid)
            case "clock" if self._wall:
                self._wall.jump(0.0)
            case "unplug" if self._cable:
                self._cable.plug_in()
        blow.ended = time.monotonic()
        if fault.is_message:
            self._set_rules()

    def _set_rules(self, adding: Blow | None = None) -> None:
        blows = [*self.blows, *([adding] if adding else [])]
        rules = [b.fault.rule for b in blows if b.fault.is_message and b.ended is None]
        self._mangler.set(tuple(rules))

    def _follow(self) -> None:
        """Note what has come back."""
        for blow in self.blows:
            restarted = time.monotonic() > blow.began + blow.fault.lasts
            if blow.ended is None and blow.fault.kind == "kill" and restarted:
                blow.ended = time.monotonic() if self._is_back(blow.fault.target) else None
            if blow.ended is not None and blow.resumed is None and self._good >= blow.ended:
                blow.resumed = self._good

    def _is_back(self, name: str) -> bool:
        if name in ROUTERS:
            return _answers(self._services[name].options.listen)
        return any(_names(member, name) for member in self._alive.now)

    def _on_plan(self, message: PlanMessage) -> None:
        plan = message.plan
        if plan.tick == anchor_tick(plan.number) or self._script.clock == "lockstep":
            self._newest = max(self._newest, plan.number)
            if not message.failed:
                self._good = time.monotonic()

    def _on_end(self, _message: RunEnd) -> None:
        self.over = self.over or time.monotonic()


def _free_endpoint(host: str = "127.0.0.1") -> str:
    """An endpoint below the ports that systems hand out to others between now and its use."""
    while True:
        port = int(np.random.default_rng().integers(15_000, 32_000))
        with socket.socket() as probe:
            if probe.connect_ex((host, port)) != 0:
                return f"tcp/{host}:{port}"


def _names(member: Member, service: str) -> bool:
    roles = {"state-estimator": "estimator", "robot-interface": "robot"}
    return member.role == roles.get(service, service) or member.id == service


def _answers(endpoint: str) -> bool:
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    with socket.socket() as probe:
        probe.settimeout(0.1)
        return probe.connect_ex((host, int(port))) == 0


@contextmanager
def _stderr_to(path: Path) -> Iterator[None]:
    """Send what this process and its children say to a file."""
    saved = os.dup(2)
    try:
        with path.open("wb") as file:
            os.dup2(file.fileno(), 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
