"""Services as commands, one by one."""

import subprocess
import sys

import pytest

from sumo_dist.cli import main


def start(*args):
    return subprocess.Popen(
        [sys.executable, "-m", "sumo_dist", *args], stderr=subprocess.PIPE, text=True
    )


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["rollout-worker", "--connect", "foo"], "'foo' is not an endpoint; valid: tcp/HOST:PORT"),
        (["state-estimator", "--robot", "a/b"], "robot 'a/b' is not a valid name"),
        (["tracer", "--robot", "pool"], "robot 'pool': the keys of rollout workers have this"),
        (["optimizer", "--engine", "warp"], "unknown engine 'warp'; valid: auto, fallback"),
    ],
)
def test_a_service_that_cannot_start_says_why_in_one_line(args, message):
    service = start(*args)
    _, err = service.communicate(timeout=30)
    assert service.returncode == 2
    assert err.startswith("sumo-dist: ")
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--name", "*"], "worker '*' is not a valid name"),
        (["--threads", "0"], "threads must be from 1 to 256, got 0"),
    ],
)
def test_a_workers_options_are_checked_before_it_looks_for_a_router(capsys, args, message):
    assert main(["rollout-worker", *args]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_without_a_router_a_service_gives_up_and_says_how_to_start_one():
    dead = "tcp/127.0.0.1:9"
    worker = [sys.executable, "-m", "sumo_dist", "rollout-worker", "--connect", dead]
    done = subprocess.run(worker, stderr=subprocess.PIPE, text=True, check=False, timeout=60)
    assert done.returncode == 3
    assert done.stderr == (
        "sumo-dist: no router at tcp/127.0.0.1:9 (waited 10 s): "
        "start one with `sumo-dist router --listen tcp/127.0.0.1:9`\n"
    )
