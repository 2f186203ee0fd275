"""The rollout backend inside the judo-rai wheel, as a yardstick, in an environment of its own.

It is never imported here: it needs MuJoCo 3.6. A child process serves it, one round at a time.
docs/results/bench_rollout.md says how the environment is made.
"""

import json
import subprocess
from multiprocessing import connection
from pathlib import Path
from typing import Any

import numpy as np

from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.bench.measure.variant import Round
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.policies.fetch import policy_file
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK

CHILD = Path(__file__).with_name("reference_child.py")
TIMESTEP = 0.01  # the reference's, twice per policy step [s]
ANSWER_S = 120.0  # a round that takes longer is lost


class Reference:
    """The reference's backend in a child process. A context manager."""

    def __init__(self, python: Path, snapshot: Snapshot, commands: np.ndarray) -> None:
        """Start it for commands (B, T, nc), by the interpreter of its environment."""
        setup = {
            "package_root": str(CHILD.parents[3]),
            "task": snapshot.task,
            "policy": str(policy_file(load_task(snapshot.task).scene.robot.policy)),
            "timestep": TIMESTEP,
            "substeps": round(TICK / TIMESTEP),
            "state": snapshot.state.tolist(),
            "memory": snapshot.memory.tolist(),
            "commands": commands.tolist(),
        }
        try:
            self._child = subprocess.Popen(
                [str(python), "-P", str(CHILD)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                start_new_session=True,  # Ctrl-C is ours to handle
            )
        except OSError as error:
            raise UsageError(f"no reference at {python}: {error.strerror}") from None
        self._send(json.dumps(setup))

    def round(self, density: float) -> Round:
        """Roll out once at a fluid density [kg/m^3]."""
        self._send(str(density))
        assert self._child.stdout is not None
        if not connection.wait([self._child.stdout.fileno()], ANSWER_S):
            raise SumoError(f"the reference gave no answer in {ANSWER_S:g} s")
        line = self._child.stdout.readline()
        if not line:
            raise SumoError("the reference's process ended; see its messages above")
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
            raise SumoError("the reference's process ended; see its messages above") from None
