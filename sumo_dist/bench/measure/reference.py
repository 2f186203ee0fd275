"""The rollout backend inside the judo-rai wheel, in an environment of its own, as a yardstick.

It is never imported here: it needs MuJoCo 3.6. A child process serves it, one round at a time.
"""

import json
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from multiprocessing import connection
from pathlib import Path
from typing import Any

import numpy as np

from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.bench.measure.variant import Round
from sumo_dist.errors import SumoError
from sumo_dist.policies.fetch import cache_dir, policy_file
from sumo_dist.policies.manifest import pinned_policy
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK

WORKER = Path(__file__).with_name("reference_worker.py")
PACKAGES = ("mujoco==3.6.0", "numpy>=2,<3")
TIMESTEP = 0.01  # the reference's, twice per policy step [s]
ANSWER_S = 120.0  # a round that takes longer is lost
INSTALL_S = 600.0
ENDED = "the reference's process ended; see its messages above"


class Reference:
    """The reference's backend in a child process. A context manager."""

    def __init__(
        self, snapshot: Snapshot, commands: np.ndarray, tell: Callable[[str], None]
    ) -> None:
        """Start it for commands (B, T, nc), making its environment on first need."""
        self._child = subprocess.Popen(
            [str(_environment(tell)), "-P", str(WORKER)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is ours to handle
        )
        setup = {
            "package_root": str(WORKER.parents[3]),
            "task": snapshot.task,
            "policy": str(policy_file(load_task(snapshot.task).scene.robot.policy)),
            "timestep": TIMESTEP,
            "substeps": round(TICK / TIMESTEP),
            "state": snapshot.state.tolist(),
            "memory": snapshot.memory.tolist(),
            "commands": commands.tolist(),
        }
        self._send(json.dumps(setup))

    def round(self, density: float) -> Round:
        """Roll out once at a fluid density [kg/m^3]."""
        self._send(str(density))
        assert self._child.stdout is not None
        if not connection.wait([self._child.stdout.fileno()], ANSWER_S):
            raise SumoError(f"the reference gave no answer in {ANSWER_S:g} s")
        line = self._child.stdout.readline()
        if not line:
            raise SumoError(ENDED)
        answer: dict[str, Any] = json.loads(line)
        return Round(answer["wall_ms"], answer["cpu_ms"], np.array(answer["final"]))

    def __enter__(self) -> "Reference":
        return self

    def __exit__(self, *_: object) -> None:
        self._child.kill()
        self._child.communicate()

    def _send(self, line: str) -> None:
        assert self._child.stdin is not None
        try:
            self._child.stdin.write(line + "\n")
            self._child.stdin.flush()
        except BrokenPipeError:
            raise SumoError(ENDED) from None


def environment_folder() -> Path:
    """Return where the reference's environment is made."""
    wheel = pinned_policy("spot").wheel
    return cache_dir().parent / f"bench-{wheel.name}-{wheel.version}"


def _environment(tell: Callable[[str], None]) -> Path:
    """Return the interpreter of the reference's environment; a stamp says that it is complete."""
    wheel, folder = pinned_policy("spot").wheel, environment_folder()
    python, stamp = folder / "bin" / "python", folder / "complete"
    if not stamp.exists():
        tell(f"making an environment for {wheel.requirement} and {PACKAGES[0]} in {folder}")
        _run(_interpreter(wheel.tag), "-m", "venv", "--clear", str(folder))
        pinned = folder / "requirements.txt"
        pinned.write_text(f"{wheel.requirement} --hash=sha256:{wheel.sha256}\n", encoding="ascii")
        exactly = ("--no-deps", "--only-binary=:all:", "--require-hashes", "-r", str(pinned))
        for what in (PACKAGES, exactly):
            _run(str(python), "-m", "pip", "install", "--disable-pip-version-check", *what)
        stamp.touch()
    return python


def _interpreter(tag: str) -> str:
    """Find the Python that the pinned wheel is for."""
    version = f"3.{tag[3:5]}"  # cp311-... is for 3.11
    if sys.platform != "linux" or not tag.endswith(f"_{platform.machine()}"):
        raise SumoError(f"the reference is a wheel for {tag}: this machine cannot run it")
    if f"{sys.version_info.major}.{sys.version_info.minor}" == version:
        return sys.executable
    if (found := shutil.which(f"python{version}")) is None:
        raise SumoError(f"the reference needs Python {version}: there is no python{version} here")
    return found


def _run(*command: str) -> None:
    """Run a step of making the environment."""
    failed = "cannot make the reference's environment"
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=INSTALL_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise SumoError(f"{failed} in {INSTALL_S:g} s") from None
    if done.returncode != 0:
        raise SumoError(f"{failed}:\n{done.stderr.strip()[-1000:]}")
