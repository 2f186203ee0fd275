"""The instant that rollouts are timed from: the robot walks and pushes, so all contacts count.

One of each robot comes with the package, so that figures can be compared over time: the start of a
plan, around which robot (0.2 m/s) and object (0.1 m/s) keep moving for a second, in a recording of
`sumo-dist run spot/move_box --seed 1` and of `sumo-dist run g1/box_push --seed 1`.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sumo_dist.errors import unknown
from sumo_dist.math import splines
from sumo_dist.optim import noise_ramp
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK

PUSHING = {robot: Path(__file__).with_name(f"{robot}_pushing.json") for robot in ("spot", "g1")}
ARRAYS = {"state": np.float64, "memory": np.float32, "knots": np.float32}

NOISE_SEED = 1


@dataclass(frozen=True)
class Snapshot:
    """A state that rollouts start from, and the plan that their commands are sampled around.

    Attributes:
        task: its name.
        source: where it comes from, for a reader.
        state: (nq + nv,).
        memory: (nm,) policy memory of the same instant.
        knots: (K, n) normalised actions of the plan made there.
        horizon: of the plan [s].
        spline: its order.
    """

    task: str
    source: str
    state: np.ndarray
    memory: np.ndarray
    knots: np.ndarray
    horizon: float
    spline: splines.Order

    @classmethod
    def load(cls, robot: str = "spot") -> "Snapshot":
        """Read the snapshot of a robot.

        Raises:
            UsageError: there is none of this robot.
        """
        if robot not in PUSHING:
            raise unknown("robot", robot, PUSHING)
        fields = json.loads(PUSHING[robot].read_text(encoding="utf-8"))
        arrays = {name: np.array(fields[name], dtype) for name, dtype in ARRAYS.items()}
        return cls(**{**fields, **arrays})

    def commands(self, rollouts: int) -> np.ndarray:
        """Sample policy commands (B, T, nc) around the plan, the plan's own first.

        The noise is the paper's and drawn here: what is timed must not change with the planner.
        """
        rng = np.random.Generator(np.random.Philox(NOISE_SEED))
        noise = rng.standard_normal((rollouts, *self.knots.shape))
        noise[0] = 0.0
        sigma = noise_ramp(0.02, 0.6, *self.knots.shape)
        knots = np.clip(self.knots + sigma * noise, -1.0, 1.0)
        times = np.arange(round(self.horizon / TICK)) * TICK
        weights = splines.weights(self.spline, len(self.knots), self.horizon, times)
        return load_task(self.task).actions.commands(splines.evaluate(weights, knots))
