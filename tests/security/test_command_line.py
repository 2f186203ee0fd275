"""Keys from the command line: one realtime run, a worker on another host, and what ends them."""

import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest

from sumo_dist.authority.folder import KeyFolder
from sumo_dist.authority.store import Authority
from sumo_dist.cli import main
from sumo_dist.record.recording import Recording
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import WORKER
from sumo_dist.wire.messages import PlanMessage

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

SPEED = "0.05"  # of the wall clock: the robot sits down after two seconds without states
RUN = (
    *("run", "spot/move_box", "--viewer", "none", "--workers", "1", "--time-limit", "60"),
    *("--set", "rollouts=4", "--set", "horizon=0.4", "--wait", "60"),
    *("--set", "variance_first=0.01", "--set", "variance_last=0.01"),  # it stands, and never falls
)


@contextmanager
def sumo_dist(log, *words):
    """A command in a process of its own, whose messages go into a file."""
    with log.open("w") as out:
        command = [sys.executable, "-P", "-m", "sumo_dist", *map(str, words)]
        process = subprocess.Popen(command, stdout=out, stderr=out)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.terminate()
        process.wait(60.0)


def test_a_host_with_keys_joins_a_run_and_is_revoked_and_planning_goes_on(
    tmp_path, free_endpoint, eventually, capfd
):
    authority = Authority.found(tmp_path / "keys")
    authority.host("here", ["router", "operator", "tracer"], [], 1.0)
    authority.host("far", ["worker"], [], 1.0)
    keys = authority.home / "hosts" / "here"
    stolen = (authority.home / "hosts" / "far" / "worker").rename(tmp_path / "worker")
    endpoint = free_endpoint().replace("tcp/", "tls/")
    at, plans, logs = ("--connect", endpoint), [], [tmp_path / "run.log", tmp_path / "worker.log"]
    pace = ("--clock", "realtime", "--speed", SPEED, "--out", tmp_path / "out")
    with (
        sumo_dist(logs[0], *RUN, *pace, "--listen", endpoint, "--keys", keys) as run,
        sumo_dist(logs[1], "rollout-worker", *at, "--keys", stolen, "--name", "w-1") as worker,
        Bus.dial(endpoint, "spot", timeout=60.0, keys=KeyFolder.read(keys / "tracer")) as bus,
    ):

        def planned(more):
            end = len(plans) + more
            return eventually(lambda: len(plans) >= end or run.poll() is not None, 60.0)

        bus.subscribe(PlanMessage, lambda plan: plans.append(int(plan.finite.sum())))
        workers = bus.watch(WORKER)
        assert eventually(lambda: f"serving spot at {endpoint}" in logs[1].read_text(), 60.0)
        assert eventually(lambda: {one.id for one in workers.now} == {"w-1", "local-0"}, 60.0)
        assert planned(2)

        authority.revoke("far")
        again = "the list of revoked keys has changed: all services dial again"
        assert eventually(lambda: again in logs[0].read_text(), 60.0)
        assert eventually(lambda: {one.id for one in workers.now} == {"local-0"}, 60.0)
        plans.clear()
        assert planned(4)
        assert eventually(lambda: plans[-1] > 0, 60.0)
        # "eventually": w-1 may leave before the others do, to dial again
        assert eventually(lambda: {one.id for one in workers.now} == {"local-0"}, 60.0)
        assert main(["top", "--worker", "w-1", *at, "--keys", str(keys / "operator")]) == 1
        worker.terminate()
        assert worker.wait(60.0) == 0

        assert main(["stop", *at]) == 2
        assert main(["stop", *at, "--keys", str(stolen)]) == 3
        assert main(["stop", *at, "--keys", str(keys / "operator"), "--reason", "a test"]) == 0
        run.send_signal(signal.SIGINT)  # to sit down takes a while
        assert run.wait(60.0) in (3, 130)
    said = capfd.readouterr().err
    assert f"{endpoint} needs --keys DIR, a folder that `sumo-dist keys host` has made" in said
    assert "is for the role worker; needed here: operator" in said
    assert not any("Traceback" in log.read_text() for log in logs)
    recording = Recording.load(tmp_path / "out" / "run.npz")
    (command,) = recording.operator
    assert (command["verb"], command["value"]) == ("stop", "a test")
    assert min(state[2] for state in recording.states[: command["tick"]]) > 0.4  # it stood


def test_a_run_that_is_open_to_all_says_so_in_every_log_and_in_the_view(tmp_path, read_rrd):
    pytest.importorskip("rerun")
    log, out = tmp_path / "log", tmp_path / "out"
    words = ("--listen", "tcp/0.0.0.0:0", "--insecure", "--rrd", "--out", out)
    with sumo_dist(log, *RUN, "--time-limit", "0.2", *words) as run:
        assert run.wait(120.0) == 1  # out of time
    said = log.read_text().splitlines()
    assert sum("INSECURE: whoever reaches tcp/0.0.0.0:" in line for line in said) == 1
    shouts = [line.partition(": ")[0] for line in said if "INSECURE: the router takes any" in line]
    assert len(shouts) == 5, said  # tracer, estimator, optimizer, worker and robot
    shown = read_rrd(out / "run.rrd").timed["/events"]
    assert sum("INSECURE" in text for texts in shown["TextLog:text"] for text in texts) == 1
