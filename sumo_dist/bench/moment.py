"""The instant that rollouts are timed from: the robot walks and pushes, so all contacts count.

`spot_pushing.json` comes with the package, so that figures can be compared over time. It is
`Moment.pushing(Recording.load(DIR / "run.npz"))` of `sumo-dist run spot/move_box --seed 1`.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from sumo_dist.errors import SumoError
from sumo_dist.math import splines
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.optim import noise_ramp
from sumo_dist.record.recording import Recording
from sumo_dist.rollout.interface import TICK
from sumo_dist.tasks import load_task

PUSHING = Path(__file__).with_name("spot_pushing.json")

OBJECT_SPEED, BASE_SPEED = 0.1, 0.2  # while it walks and pushes, at least [m/s]
AROUND = 25  # ticks before and after
NOISE_SEED = 1


@dataclass(frozen=True)
class Moment:
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
    def pushing(cls, recording: Recording) -> "Moment":
        """Return the first plan's start around which robot and object keep moving for 1 s."""
        config, states = recording.config, np.array(recording.states)
        task = load_task(config["task"])
        index = StateIndex(compile_model(task.scene, PLANT))
        thing = task.frames["object"].name
        moving = np.minimum(
            _speed(states, index, thing) / OBJECT_SPEED,
            _speed(states, index, task.scene.robot.base) / BASE_SPEED,
        )
        for number, tick in enumerate(recording.plan_ticks):
            around = moving[max(0, tick - AROUND) : tick + AROUND + 1]
            if len(around) == 2 * AROUND + 1 and around.min() > 1.0:
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
    def load(cls, path: Path = PUSHING) -> "Moment":
        """Read a moment."""
        fields = json.loads(path.read_text(encoding="utf-8"))
        types = {"state": np.float64, "memory": np.float32, "knots": np.float32}
        return cls(**{**fields, **{name: np.array(fields[name], t) for name, t in types.items()}})

    def save(self, path: Path) -> None:
        """Write a moment; its numbers come back bit by bit."""
        arrays = {name: getattr(self, name).tolist() for name in ("state", "memory", "knots")}
        path.write_text(json.dumps({**asdict(self), **arrays}, indent=1) + "\n", encoding="utf-8")

    def commands(self, rollouts: int) -> np.ndarray:
        """Sample policy commands (B, T, nc) around the plan, the plan's own first.

        The noise is the paper's and drawn here: what is timed must not change with the planner.
        """
        noise = np.random.Generator(np.random.Philox(NOISE_SEED)).standard_normal(
            (rollouts, *self.knots.shape)
        )
        noise[0] = 0.0
        sigma = noise_ramp(0.02, 0.6, *self.knots.shape)
        knots = np.clip(self.knots + sigma * noise, -1.0, 1.0)
        times = np.arange(round(self.horizon / TICK)) * TICK
        weights = splines.weights(self.spline, len(self.knots), self.horizon, times)
        return load_task(self.task).actions.commands(splines.evaluate(weights, knots))


def _speed(states: np.ndarray, index: StateIndex, body: str) -> np.ndarray:
    return np.linalg.norm(states[:, index.velocity(body)][:, :3], axis=1)
