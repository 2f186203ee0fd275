"""The instant that rollouts are timed from: the robot walks and pushes, so all contacts count.

One of each robot comes with the package, so that figures can be compared over time. They are
`Snapshot.pushing(Recording.load(DIR / "run.npz"))` of `sumo-dist run spot/move_box --seed 1`, and
the same with `in_steps=True` of `sumo-dist run g1/box_push --seed 1`.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from sumo_dist.errors import SumoError, unknown
from sumo_dist.math import splines
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.optim import noise_ramp
from sumo_dist.record.recording import Recording
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK

PUSHING = {robot: Path(__file__).with_name(f"{robot}_pushing.json") for robot in ("spot", "g1")}
ARRAYS = {"state": np.float64, "memory": np.float32, "knots": np.float32}

OBJECT_SPEED, BASE_SPEED = 0.1, 0.2  # while it walks and pushes, at least [m/s]
AROUND = 25  # ticks before and after
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
    def pushing(cls, recording: Recording, in_steps: bool = False) -> "Snapshot":
        """Return the first plan's start around which robot and object keep moving for 1 s.

        Args:
            recording: of a run.
            in_steps: a robot on two legs pushes and rests at every step: take the object's mean
                speed over that second.
        """
        config, states = recording.config, np.array(recording.states)
        task = load_task(config["task"])
        index = StateIndex(compile_model(task.scene, PLANT))
        object_speed = _speed(states, index, task.frames["object"].name)
        if in_steps and len(states) > 2 * AROUND:
            object_speed = np.convolve(object_speed, np.ones(2 * AROUND) / (2 * AROUND), "same")
        base_speed = _speed(states, index, task.scene.robot.base)
        moves = (object_speed > OBJECT_SPEED) & (base_speed > BASE_SPEED)
        for number, tick in enumerate(recording.plan_ticks):
            around = moves[max(0, tick - AROUND) : tick + AROUND + 1]
            if len(around) == 2 * AROUND + 1 and around.all():
                return cls(
                    task.name,
                    f"seed {config['seed']}, plan {recording.plan_numbers[number]}",
                    states[tick],
                    recording.memories[tick],
                    recording.knots[number],
                    config["planner"]["horizon"],
                    config["planner"]["spline"],
                )
        raise SumoError("in this run the robot never walks and pushes for a second around a plan")

    @classmethod
    def of(cls, robot: str) -> "Snapshot":
        """Read the snapshot of a robot that comes with the package.

        Raises:
            UsageError: there is none of this robot.
        """
        if robot not in PUSHING:
            raise unknown("robot", robot, PUSHING)
        return cls.load(PUSHING[robot])

    @classmethod
    def load(cls, path: Path = PUSHING["spot"]) -> "Snapshot":
        """Read a snapshot."""
        fields = json.loads(path.read_text(encoding="utf-8"))
        arrays = {name: np.array(fields[name], dtype) for name, dtype in ARRAYS.items()}
        return cls(**{**fields, **arrays})

    def save(self, path: Path) -> None:
        """Write a snapshot; its numbers come back bit by bit."""
        arrays = {name: getattr(self, name).tolist() for name in ARRAYS}
        path.write_text(json.dumps({**asdict(self), **arrays}, indent=1) + "\n", encoding="utf-8")

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


def _speed(states: np.ndarray, index: StateIndex, body: str) -> np.ndarray:
    return np.linalg.norm(states[:, index.velocity(body)][:, :3], axis=1)
