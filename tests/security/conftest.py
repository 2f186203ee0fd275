import shutil
import subprocess
import sys
import time
from contextlib import ExitStack

import pytest

from sumo_dist.authority.certificates import read_certificate
from sumo_dist.authority.folder import KeyFolder
from sumo_dist.authority.store import Authority
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.summary import read_summary
from sumo_dist.launch.deployment import Deployment, services
from sumo_dist.launch.launcher import Launcher, flags
from sumo_dist.launch.serve import Router
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.record.recording import Recording
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import topic_key
from sumo_dist.wire.notices import Health
from sumo_dist.wire.session import open_client

ROLES = ("router", "robot", "optimizer", "worker", "tracer", "operator")


def wait_for(condition, timeout=60.0):
    deadline = time.monotonic() + timeout
    while not (met := condition()) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert met


class Secured:
    """A lockstep run behind TLS that goes on under attack, and all that a local listener hears."""

    def __init__(self, stack, folder, endpoint, local):
        self.tls, self.local = endpoint.replace("tcp/", "tls/"), local
        self.authority = Authority.found(folder / "keys")
        self.authority.host("r", ROLES, [], 1.0)
        self.authority.host("mallory", ROLES[1:], [], 1.0)  # one of us who has turned
        self.out, self.heard = folder / "out", []
        self._stack, self._log = stack, folder / "router.log"
        self._start_router()
        self.ear = stack.enter_context(open_client(local, 30.0))
        self._listening = self.ear.declare_subscriber("sumo/**", self._hear)
        launcher = stack.enter_context(Launcher())
        # It stands for as long as it takes: what ends it would else be its own fall.
        calm = {"base_noise": 0.01, "variance_first": 1e-4, "variance_last": 1e-4}
        planner, still = PlannerConfig(rollouts=4, horizon=0.4, **calm), ("goal=0", "gripper=0")
        episode = EpisodeConfig("spot/move_box", 1, planner, time_limit=600.0, weight=still)
        keys = self.authority.home / "hosts" / "r"
        deployment = Deployment(
            *(episode, 1, 1, self.out, None, None, 60.0), keys=keys, give_way=False
        )
        for service in services(deployment, self.tls):
            self.robot = launcher.start(service)
        self.goes_on()
        self._issue_briefly()

    def _issue_briefly(self):
        """Let a worker in whose certificate expires while the other attacks are made."""
        self.authority.host("brief", ["worker"], [], 8 / 86400)
        keys = self.keys("worker", "brief")
        self.brief = self._stack.enter_context(Bus.dial(self.tls, "spot", keys=keys))
        self.brief_ends = keys.certificate.expires.timestamp()
        wait_for(lambda: self.hears(self.brief, "brief", "in-time"))

    def hears(self, bus, host, mark):
        """Say something on a worker's bus; return whether it was heard, now or before."""
        bus.publish(Health(mark, host, "worker", {}))
        time.sleep(0.05)
        return topic_key("spot", "health", host) in self.reached(mark.encode())

    def _start_router(self):
        options = Router(self.tls, self.local, self.authority.folder("r", "router"))
        command = [sys.executable, "-P", "-m", "sumo_dist", "router", *flags(options)]
        with self._log.open("w") as log:
            router = subprocess.Popen(command, stderr=log)
        self._stack.callback(router.wait)
        self._stack.callback(router.kill)
        wait_for(lambda: "router listening" in self.log)

    def _hear(self, sample):
        self.heard.append((str(sample.key_expr), sample.payload.to_bytes()))

    @property
    def log(self):
        return self._log.read_text()

    def told(self, *parts):
        """Count the lines of the router's log that have all of some parts."""
        return sum(all(part in line for part in parts) for line in self.log.splitlines())

    def plans(self):
        return sum("/plan" in key for key, _ in list(self.heard))

    def goes_on(self, more=5):
        """Wait until more plans are made."""
        end = self.plans() + more
        wait_for(lambda: self.plans() >= end or self.robot.poll() is not None, 120.0)
        assert self.robot.poll() is None, read_summary(self.out)["end_reason"]

    def keys(self, role, host="mallory"):
        return KeyFolder.read(self.authority.folder(host, role))

    def reached(self, mark):
        """Keys on which somebody at the router was heard with a mark."""
        return {key for key, payload in list(self.heard) if mark in payload}

    def end(self):
        """End the run; return its recording."""
        self.robot.send_signal(2)
        assert self.robot.wait(60.0) == 130
        return Recording.load(self.out / "run.npz")


@pytest.fixture(scope="module")
def secured(free_endpoint, tmp_path_factory):
    with ExitStack() as stack:
        folder = tmp_path_factory.mktemp("secured")
        yield Secured(stack, folder, free_endpoint(), free_endpoint())


@pytest.fixture
def unchecked():
    """Return a function: keys as an attacker has them, who does not check his own."""

    def unchecked(folder, into=None, **instead):
        if into is not None:
            folder = shutil.copytree(folder, into)
        for name, path in instead.items():
            shutil.copy(path, folder / f"{name}.pem")
        return KeyFolder(folder, read_certificate(folder / "cert.pem"))

    return unchecked


@pytest.fixture
def port(secured):
    return int(secured.tls.rpartition(":")[2])
