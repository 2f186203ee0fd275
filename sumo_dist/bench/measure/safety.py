"""`sumo-dist bench safety`: whether walks stay within a robot's limits, and how it stops."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from sumo_dist.bench.layout import Result, check_at_least, markdown, run_bench
from sumo_dist.episode.safety import sitting_down
from sumo_dist.errors import unknown
from sumo_dist.model.scene import Scene
from sumo_dist.model.settle import settled_stand
from sumo_dist.plant.simulated import Plant
from sumo_dist.policies import load_policy
from sumo_dist.robots.g1 import g1_actions
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.robots.safety import tilt
from sumo_dist.robots.spot import SPOT, spot_actions
from sumo_dist.rollout import make_controller
from sumo_dist.tasks.g1.terms import scene
from sumo_dist.timing import TICK

ROBOTS = {"spot": (Scene(SPOT), spot_actions()), "g1": (scene(), g1_actions())}
WALKS, WALK_S = 8, 20.0  # walks, and how long each takes [s]
HOLD_S = 2.0  # a random velocity is kept this long, and at the end of each the robot is stopped [s]
WATCHED_S = 5.0  # after a stop [s]
REST_SPEED, REST_SPIN = 0.1, 0.3  # slower than this the base is at rest [m/s, rad/s]


@dataclass(frozen=True)
class Options:
    """Options of `bench safety`.

    Attributes:
        robot: spot or g1.
        seed: of the walks' velocities.
        json: print one JSON object.
    """

    robot: str = "spot"
    seed: int = 1
    json: bool = False

    def __post_init__(self) -> None:
        check_at_least(0, seed=self.seed)
        if self.robot not in ROBOTS:
            raise unknown("robot", self.robot, ROBOTS)


def main(options: Options) -> int:
    """Walk, stop, and print tables or one JSON object; 1 if the guard changed a command."""
    command = f"bench safety --robot {options.robot} --seed {options.seed}"
    result = run_bench(command, options.json, partial(measure, options), text)
    return 1 if result["changed"] else 0


class Walker:
    """Walks a robot over an empty floor, every command by the guard."""

    def __init__(self, robot: str) -> None:
        """Load robot and policy."""
        self._scene, self._actions = ROBOTS[robot]
        self.robot = self._scene.robot
        stance = settled_stand(self.robot)
        self._start = np.concatenate([stance, np.zeros(len(stance) - 1)])
        model = Plant(self._scene, self._start).model
        self._nq = model.nq
        self._controller = make_controller(load_policy(self.robot.policy), model)

    def walk(self, rng: np.random.Generator) -> Iterator[tuple[np.ndarray, CommandGuard]]:
        """Walk at random velocities; yield the state and the guard at the end of each of them."""
        plant, memory = Plant(self._scene, self._start), self._controller.initial_memory()
        guard = CommandGuard(self.robot, plant.model, plant.send, TICK)
        for _ in range(round(WALK_S / HOLD_S)):
            action = self._actions.default.copy()
            action[:3] = rng.uniform(self._actions.lower[:3], self._actions.upper[:3])
            command = self._actions.to_command(action)
            for _ in range(round(HOLD_S / TICK)):
                qpos, qvel = np.split(plant.truth, [self._nq])
                targets, memory = self._controller.step(qpos, qvel, command, memory)
                guard.send(targets)
                plant.advance()
            yield plant.truth, guard

    def stop(self, state: np.ndarray, targets: np.ndarray) -> dict[str, float]:
        """Stop a robot that walks, without its state, and watch it come to rest."""
        plant, tilts, speeds, resting = Plant(self._scene, state), [], [], []
        guard = CommandGuard(self.robot, plant.model, plant.send, TICK)
        guard.last = targets
        motion = list(sitting_down(self.robot, targets))
        motion += [motion[-1]] * (round(WATCHED_S / TICK) - len(motion))
        for joints in motion:
            guard.send(joints)
            plant.advance()
            linear, angular = np.split(plant.truth[self._nq :][:6], [3])
            tilts.append(np.degrees(tilt(plant.truth)))
            speeds.append(float(np.linalg.norm(linear)))
            resting.append(speeds[-1] < REST_SPEED and np.linalg.norm(angular) < REST_SPIN)
        moved = [i for i, rest in enumerate(resting) if not rest]
        return {
            "most tilt [deg]": max(tilts),
            "tilt at the end [deg]": tilts[-1],
            "height at the end [m]": float(plant.truth[2]),
            "most speed of the base [m/s]": max(speeds),
            "at rest after [s]": (moved[-1] + 1) * TICK if moved else 0.0,
        }


def measure(options: Options) -> Result:
    """Walk some times, and stop out of the walks."""
    walker, rng = Walker(options.robot), np.random.default_rng(options.seed)
    stops, changed = [], 0
    for _ in range(WALKS):
        guard = None
        for state, guard in walker.walk(rng):
            stops.append(walker.stop(state, guard.last))
        changed += sum(guard.changed.values()) if guard else 0
    commands = WALKS * round(WALK_S / TICK)
    return {"stops": stops, "commands": commands, "changed": changed}


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    yield (
        f"{WALKS} walks of {WALK_S:g} s at random velocities: {result['commands']} commands, "
        f"{result['changed']} changed by the guard."
    )
    yield f"{len(result['stops'])} safe stops out of the walks, watched for {WATCHED_S:g} s:"
    ends = [
        (name, *(f"{q:.2f}" for q in np.quantile([s[name] for s in result["stops"]], (0, 0.5, 1))))
        for name in result["stops"][0]
    ]
    yield markdown(("of a stop", "least", "median", "most"), ends)
