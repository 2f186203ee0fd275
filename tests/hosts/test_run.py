"""Runs on hosts that are network namespaces with an sshd each: what is said, what is left over."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from sumo_dist.authority.store import Authority
from sumo_dist.record.recording import Recording

from . import network

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
PATIENCE_S = 120.0  # a busy machine
LEFT_S = 10.0  # after a launcher's death
FEW = (
    *("--viewer", "none", "--seed", "5", "--no-give-way"),
    *("--set", "rollouts=4", "--set", "horizon=0.4"),
)
QUICK = (*FEW, "--time-limit", "0.2")
# A robot that wants nothing but to stand, and hardly tries anything else.
ENDLESS = (
    *("spot/move_box", *FEW, "--time-limit", "3000", "--set", "base_noise=0.01"),
    *("--set", "variance_first=0.0001", "--set", "variance_last=0.0001"),
    *("--weight", "goal=0", "--weight", "gripper=0"),
)
ROLES = {
    "robot": ["robot"],
    "brain": ["router", "optimizer"],
    "w1": ["worker"],
    "w2": ["robot", "worker"],  # it has the estimator
}
TASK = """
from helper import near
from sumo_dist.tasks.spot.families import Manipuland, move

def task():
    return move(Manipuland("barrel", "models/barrel.xml", rest_z=near(0.35)))
"""
BARREL = """<mujoco model="barrel"><worldbody><body name="barrel"><freejoint/>
<geom type="cylinder" size="0.25 0.35" mass="6" priority="6"/></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def net(tmp_path_factory):
    if reason := network.lacking():
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("hosts")
    with network.Network(folder, ["robot", "brain", "w1", "w2"]) as net:
        net.reachable()
        authority = Authority.found(folder / "authority")
        for name, roles in ROLES.items():
            authority.host(name, roles, [net.address(name)], days=30)
        (folder / "hosts.toml").write_text(
            'keys = "authority"\n'
            + net.table("robot", roles=["robot"])
            + net.table("brain", roles=["router", "optimizer"], address=net.address("brain"))
            + net.table("w1", workers=1)
            + net.table("w2", roles=["estimator"], workers=1)
        )
        here = {"roles": ["router", "robot", "optimizer"], "workers": 1}
        (folder / "near.toml").write_text(
            "insecure = true\n"
            + net.table("local", **here, address=f"{net.launcher}:7452")
            + net.table("w1", workers=1)
        )
        yield net


class Run:
    """`sumo-dist run --hosts` in a process of its own."""

    def __init__(self, net, task, *words, hosts="hosts.toml"):
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-P", "-m", "sumo_dist", "run", str(task)),
                *("--hosts", str(net.folder / hosts), *map(str, words)),
            ],
            cwd=net.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.lines = []
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.append(line)

    @property
    def said(self):
        return "".join(self.lines)

    def until(self, text, after=0):
        """Wait until it has said something; return how much it had said then."""
        deadline = time.monotonic() + PATIENCE_S
        while text not in self.said[after:]:
            assert self.process.poll() is None, f"it has ended: {self.said}"
            assert time.monotonic() < deadline, f"waited for {text!r}: {self.said}"
            time.sleep(0.05)
        return self.said.index(text, after)

    def end(self):
        """Return the exit code."""
        code = self.process.wait(PATIENCE_S)
        self._reading.join(10)
        return code


@pytest.fixture
def run(net):
    begun = []

    def run(task, *words, **hosts):
        begun.append(Run(net, task, *words, **hosts))
        return begun[-1]

    yield run
    for one in begun:
        if one.process.poll() is None:
            one.process.kill()
            one.process.wait()


def left(net):
    """What runs on the hosts, and what of the launcher's ssh here."""
    clients = network.call("pgrep", "-f", f"^ssh .*{net.folder}", check=False).stdout.split()
    return {name: net.processes(name) for name in net.names} | {"ssh": clients}


def nothing_left(net, eventually):
    assert eventually(lambda: not any(left(net).values()), LEFT_S), left(net)


def test_a_task_of_ones_own_is_run_and_fetched(run, net, eventually, tmp_path):
    """Its file, a module and a model beside it are nowhere but here, and go to every host."""
    folder = tmp_path / "my tasks"
    (folder / "models").mkdir(parents=True)
    (folder / "bring.py").write_text(TASK)
    (folder / "helper.py").write_text("def near(height):\n    return height\n")
    (folder / "models" / "barrel.xml").write_text(BARREL)
    out = tmp_path / "out"
    words = ("--out", out)
    one = run(folder / "bring.py", *QUICK, *words)
    assert one.end() == 1, one.said  # in so short a time it brings nothing
    assert "not solved: timeout, 4 plans" in one.said
    assert "brain/router: " in one.said
    assert "brain/optimizer: sumo_dist.optimizer: worker w1-0 joined" in one.said
    assert {path.name for path in out.iterdir()} == {"run.npz", "summary.json", "services.log"}
    assert "brain/router: " in (out / "services.log").read_text()
    nothing_left(net, eventually)
    assert list((net.home("robot") / "runs").iterdir()) == []  # it was fetched
    assert list((net.home("w1") / "agents").iterdir()) == []
    key = net.home("brain") / "keys" / "brain" / "router" / "key.pem"
    assert key.stat().st_mode & 0o777 == 0o600
    alone = [sys.executable, "-P", "-m", "sumo_dist", "run", folder / "bring.py", *QUICK, *words]
    subprocess.run(
        [*map(str, alone[:-1]), str(tmp_path / "alone"), "--workers", "0"],
        check=False,
        timeout=PATIENCE_S,
    )
    here, there = (json.loads((p / "summary.json").read_text()) for p in (tmp_path / "alone", out))
    assert here["plan_digest"] == there["plan_digest"]
    assert Recording.load(out / "run.npz").plan_digest == there["plan_digest"]


def test_a_cut_worker_comes_back_and_a_cut_optimizer_ends_all(run, net, eventually, tmp_path):
    one = run(*ENDLESS, "--out", tmp_path / "out")
    one.until("plan ")
    net.cut("w1")
    try:
        lost = one.until("sumo-dist: lost w1 (")
        assert eventually(lambda: not net.processes("w1"), LEFT_S)  # its agent heard nothing
        again = one.until("plan ", lost)  # without it
    finally:
        net.mend("w1")
    back = one.until("w1 is back", again)
    one.until("worker w1-0 joined", back)
    one.until("plan ", back)
    net.cut("brain")
    try:
        assert one.end() == 3, one.said
        assert "lost brain (router, optimizer): " in one.said
        nothing_left(net, eventually)
    finally:
        net.mend("brain")
    assert (tmp_path / "out" / "run.npz").exists()  # the robot has kept what there was


def test_a_launcher_that_is_killed_leaves_nothing(run, net, eventually):
    one = run(*ENDLESS, "--out", "killed", hosts="near.toml")
    one.until("worker w1-0 joined")
    one.until("plan ")
    assert "INSECURE: whoever reaches" in one.said
    assert net.processes("w1")
    assert local_services(one)
    services = local_services(one)
    one.process.send_signal(signal.SIGKILL)
    nothing_left(net, eventually)
    assert eventually(lambda: not any(map(lives, services)), LEFT_S)


@pytest.mark.parametrize(
    ("killed", "code", "says"),
    [
        (False, 130, "not solved: interrupted"),
        (True, 3, "sumo-dist: optimizer on local ended with SIGKILL; see its messages above"),
    ],
)
def test_an_end_by_hand_or_fault_ends_all(run, net, eventually, tmp_path, killed, code, says):
    one = run(*ENDLESS, "--out", tmp_path / "out", hosts="near.toml")
    one.until("plan ")
    services = local_services(one)
    if killed:
        (optimizer,) = [p for p in services if " optimizer " in network.command_of(p)]
        os.kill(optimizer, signal.SIGKILL)
    else:
        one.process.send_signal(signal.SIGINT)
    assert one.end() == code, one.said
    assert says in one.said
    assert (tmp_path / "out" / "run.npz").exists()
    nothing_left(net, eventually)
    assert not any(map(lives, services))


def local_services(run):
    """Processes of the launcher's own host."""
    agents = network.children(run.process.pid)
    return [pid for agent in agents for pid in network.children(agent)]


def lives(pid):
    return "sumo_dist" in network.command_of(pid)


def test_the_doctor_says_what_each_host_is_fit_for_and_a_run_what_is_not(run, net):
    venv = net.home("w1") / ".venv"
    at = venv.readlink()
    venv.unlink()
    net.cut("w2")
    try:
        done = subprocess.run(
            [
                *(sys.executable, "-P", "-m", "sumo_dist", "doctor"),
                *("--hosts", str(net.folder / "hosts.toml")),
            ],
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE_S,
        )
        one = run("spot/move_box", "--out", "refused")
        assert one.end() == 3
    finally:
        venv.symlink_to(at)
        net.mend("w2")
    assert "host w2 cannot be reached: ssh: connect to host" in one.said
    assert "try: ssh -o BatchMode=yes root@" in one.said
    assert done.returncode == 3, done.stderr
    lines = [line.split(None, 3) for line in done.stdout.splitlines()]
    found = {(host, what): (level, text) for level, host, what, text in lines}
    assert found["robot", "reach"][0] == "ok"
    assert found["robot", "router"][1].endswith("where nobody listens yet")
    assert found["robot", "version"][0] == "ok"
    assert found["robot", "keys"][0] == "ok"
    assert found["brain", "keys"][1].startswith("optimizer, router; that of ")
    assert abs(float(found["robot", "clock"][1].split()[0])) < 0.5
    assert "free here" in found["robot", "disk"][1]
    assert "rollouts/s" in found["brain", "planning"][1]
    assert found["w1", "version"][0] == "warn"
    assert "`run --hosts` installs that" in found["w1", "version"][1]
    assert found["w2", "reach"][0] == "fail"
    assert found["all", "engines"][0] == "skip"
