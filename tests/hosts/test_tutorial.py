"""The page from one machine to three: every command of it, on namespaces in place of machines."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from . import network

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
PAGE = Path(__file__).parents[2] / "docs" / "tutorials" / "more-machines.md"
ADDRESS = "192.168.7.20"
QUICK = "--set rollouts=4 --set horizon=0.4 --time-limit 0.2"
# What the page calls them, and as what they are the same here, in an environment that is there.
PROGRAM = shlex.join((sys.executable, "-P", "-m", "sumo_dist"))


def blocks(language):
    return re.findall(
        rf"^```{language}\n(.*?)^```", PAGE.read_text("utf-8"), re.DOTALL | re.MULTILINE
    )


def here(line, net):
    """A command of the page, as it is typed here."""
    line = line.replace(ADDRESS, net.address("planner"))
    if line.startswith("deploy/launch"):
        line = line.replace("deploy/launch", "sumo-dist run")
    if line.startswith("sumo-dist run"):
        line += f" {QUICK}"
    return re.sub(r"^sumo-dist\b", PROGRAM, line)


def test_every_command_of_the_page_does_what_it_says(tmp_path):
    if reason := network.lacking():
        pytest.skip(reason)
    (inventory,) = blocks("toml")
    commands = [line for block in blocks("sh") for line in block.splitlines()]
    with network.Network(tmp_path / "net", ["robot", "planner", "tower"]) as net:
        net.reachable()
        for name in net.names:  # as ~/.ssh/config and a home directory of its own would
            inventory = inventory.replace(f"[hosts.{name}]\n", net.table(name))
        (tmp_path / "hosts.toml").write_text(inventory.replace(ADDRESS, net.address("planner")))
        said = {}
        for line in commands:
            done = subprocess.run(
                here(line, net),
                shell=True,
                cwd=tmp_path,
                capture_output=True,
                text=True,
                check=False,
                timeout=200,
            )
            expected = 1 if line.startswith("deploy/launch") else 0  # it has no time to solve it
            assert done.returncode == expected, f"{line}: {done.stdout}{done.stderr}"
            said[line.split()[1]] = done.stdout + done.stderr
        assert not any(net.processes(name) for name in net.names)
    assert len(commands) == 8
    assert "fail" not in said["doctor"]
    assert "timeout, 4 plans" in said["spot/move_box"]
    assert {p.name for p in (tmp_path / "together").iterdir()} >= {"run.npz", "services.log"}
    assert (tmp_path / "together.rrd").exists()
    for role in ("robot", "planner", "tower"):
        assert f"\n# {role}: " in said["run"]
