"""What is printed for hosts without ssh, typed into shells here."""

import os
import signal
import subprocess
import sys

import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.hosts.inventory import Host, Inventory
from sumo_dist.hosts.printed import printed
from sumo_dist.launch.deployment import Deployment
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.wire.session import nobody_listens

PATIENCE_S = 120.0


def blocks(inventory, tmp_path, task="spot/move_box"):
    quick = PlannerConfig(rollouts=4, horizon=0.4)
    config = EpisodeConfig(task, seed=5, planner=quick, time_limit=0.2)
    deployment = Deployment(config, 0, 1, tmp_path, None, speed=None, wait=60.0)
    return printed(inventory, deployment).split("\n\n")


@pytest.mark.slow
def test_the_commands_run_together_and_end_together(endpoint, tmp_path):
    folder = tmp_path / "a folder"
    folder.mkdir()
    (folder / ".venv").symlink_to(sys.prefix)
    robot = Host(
        *("far", ("router", "robot", "optimizer")),
        address=endpoint.removeprefix("tcp/"),
        folder=str(folder),
    )
    first, *both = blocks(
        Inventory((Host("local", workers=1, folder=str(tmp_path / "here")), robot)), tmp_path
    )
    assert "the host of the router first" in first
    assert both[0].startswith("# far: router, state-estimator, optimizer, robot-interface\n")
    assert f"# the recording will be in {folder}/runs/by-hand\n" in both[0]
    assert both[1].startswith("# local: worker-0\n")
    shells = [
        subprocess.Popen(
            ["sh", "-c", block],
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        for block in both
    ]
    try:
        assert shells[0].wait(PATIENCE_S) == 1, shells[0].stderr.read()  # the robot's exit code
        assert (folder / "runs" / "by-hand" / "run.npz").exists()
        os.killpg(shells[1].pid, signal.SIGINT)  # as Ctrl-C does
        said = [shell.communicate(timeout=PATIENCE_S)[1] for shell in shells]  # all have ended
    finally:
        for shell in shells:
            if shell.poll() is None:
                os.killpg(shell.pid, signal.SIGKILL)
    assert "worker local-0 joined" in said[0]
    assert nobody_listens(endpoint)


def test_what_has_to_be_there_is_said(tmp_path):
    (tmp_path / "box.xml").write_text(
        '<mujoco><worldbody><body name="box"><freejoint/><geom size="0.3" mass="5"/></body>'
        "</worldbody></mujoco>"
    )
    (tmp_path / "my task.py").write_text(
        "from sumo_dist.tasks.spot.families import Manipuland, move\n"
        'def task():\n    return move(Manipuland("box", "box.xml", rest_z=0.3))\n'
    )
    hosts = (
        Host("brain", ("router", "robot", "optimizer"), address="10.0.0.2", folder="~/a b"),
        Host("w1", workers=2, environment=(("A", "x y"),)),
    )
    _, brain, worker = blocks(Inventory(hosts, keys="/k"), tmp_path, str(tmp_path / "my task.py"))
    assert "\n# my task.py and what is beside it must be in ~/a b/tasks/" in brain
    assert "\n# /k/hosts/brain/router must be in ~/a b/keys/brain/router\n" in brain
    assert "cd \"$HOME\"/'a b' && sh -c " in brain
    assert "/tasks/" in worker
    assert "\n# /k/hosts/w1/worker must be in ~/sumo-dist/keys/w1/worker\n" in worker
    assert worker.count("rollout-worker --connect tls/10.0.0.2:7447 ") == 2
    assert worker.count(' --keys "$PWD"/keys/w1/worker --name w1-') == 2
