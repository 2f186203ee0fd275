"""`sumo-dist bench safety`: what a robot's limits leave free, and how its safe stop ends."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from sumo_dist.bench.layout import heading, markdown
from sumo_dist.episode.safety import sitting_down
from sumo_dist.errors import UsageError, unknown
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, Scene, compile_model
from sumo_dist.model.settle import settled_stand
from sumo_dist.plant.simulated import Plant
from sumo_dist.policies import load_policy
from sumo_dist.provenance import timing_provenance
from sumo_dist.record.recording import Recording
from sumo_dist.robots.g1 import g1_actions
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.robots.safety import tilt
from sumo_dist.robots.spot import SPOT, spot_actions
from sumo_dist.rollout import make_controller
from sumo_dist.tasks import load_task
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
        runs: folders of runs of the same robot, whose commands count with those of the walks.
        robot: spot or g1.
        seed: of the walks' velocities.
        json: print one JSON object.
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    robot: str = "spot"
    seed: int = 1
    json: bool = False


@dataclass
class Peaks:
    """The most that was asked of each joint (nu,), and what it did.

    Attributes:
        low, high: targets [rad].
        rate: of the targets [rad/s].
        speed: of the joints [rad/s].
        commands: sent, and changed by the guard.
    """

    low: np.ndarray
    high: np.ndarray
    rate: np.ndarray
    speed: np.ndarray
    commands: int = 0
    changed: int = 0

    def add(self, targets: np.ndarray, speeds: np.ndarray, changed: int) -> None:
        """Take a run's targets (T, nu) [rad], the first from the stance, and speeds (T, nu)."""
        self.low = np.minimum(self.low, targets.min(axis=0))
        self.high = np.maximum(self.high, targets.max(axis=0))
        steps = np.abs(np.diff(targets, axis=0)) / TICK
        self.rate = np.maximum(self.rate, steps.max(axis=0))
        self.speed = np.maximum(self.speed, np.abs(speeds).max(axis=0))
        self.commands += len(targets) - 1
        self.changed += changed


class Walker:
    """Walks a robot over an empty floor, every command by the guard."""

    def __init__(self, robot: str) -> None:
        """Load robot and policy."""
        self._scene, self._actions = ROBOTS[robot]
        self.robot = self._scene.robot
        self._stance = settled_stand(self.robot)
        model = self._plant().model
        self._nq = model.nq
        _, self._speeds = StateIndex(model).joints(self.robot.joints)
        self._controller = make_controller(load_policy(self.robot.policy), model)

    def _plant(self, state: np.ndarray | None = None) -> Plant:
        if state is None:
            state = np.concatenate([self._stance, np.zeros(len(self._stance) - 1)])
        return Plant(self._scene, state)

    def walk(
        self, rng: np.random.Generator, peaks: Peaks
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Walk at random velocities; yield state and last targets at the end of each of them."""
        plant, memory = self._plant(), self._controller.initial_memory()
        guard = CommandGuard(self.robot, plant.model, plant.step, TICK)
        asked, speeds = [guard.last], []
        for _ in range(round(WALK_S / HOLD_S)):
            action = self._actions.default.copy()
            action[:3] = rng.uniform(self._actions.lower[:3], self._actions.upper[:3])
            command = self._actions.to_command(action)
            for _ in range(round(HOLD_S / TICK)):
                qpos, qvel = np.split(plant.state, [self._nq])
                targets, memory = self._controller.step(qpos, qvel, command, memory)
                asked.append(targets)
                guard.send(targets)
                speeds.append(plant.state[self._speeds])
            yield plant.state, guard.last
        peaks.add(np.array(asked), np.array(speeds), sum(guard.changed.values()))

    def stop(self, state: np.ndarray, targets: np.ndarray) -> dict[str, float]:
        """Stop a robot that walks, without its state, and watch it come to rest."""
        plant, tilts, resting = self._plant(state), [], []
        guard = CommandGuard(self.robot, plant.model, plant.step, TICK)
        guard.last = targets
        motion = list(sitting_down(self.robot, targets))
        motion += [motion[-1]] * (round(WATCHED_S / TICK) - len(motion))
        speed = 0.0
        for joints in motion:
            guard.send(joints)
            linear, angular = np.split(plant.state[self._nq :][:6], [3])
            tilts.append(np.degrees(tilt(plant.state)))
            speed = max(speed, float(np.linalg.norm(linear)))
            slow = np.linalg.norm(linear) < REST_SPEED and np.linalg.norm(angular) < REST_SPIN
            resting.append(bool(slow))
        moved = [i for i, rest in enumerate(resting) if not rest]
        return {
            "most tilt [deg]": max(tilts),
            "tilt at the end [deg]": tilts[-1],
            "height at the end [m]": float(plant.state[2]),
            "most speed of the base [m/s]": speed,
            "at rest after [s]": (moved[-1] + 1) * TICK if moved else 0.0,
        }


def main(options: Options) -> int:
    """Walk, stop, and print tables or one JSON object; 1 if the guard changed a command."""
    if options.robot not in ROBOTS:
        raise unknown("robot", options.robot, ROBOTS)
    if options.seed < 0:
        raise UsageError(f"seed must not be negative, got {options.seed}")
    walker, rng = Walker(options.robot), np.random.default_rng(options.seed)
    count = len(walker.robot.joints)
    peaks = Peaks(np.full(count, np.inf), np.full(count, -np.inf), np.zeros(count), np.zeros(count))
    for folder in options.runs:
        read(folder, options.robot, peaks)
    stops = [walker.stop(*at) for _ in range(WALKS) for at in walker.walk(rng, peaks)]
    result = {
        **timing_provenance(),
        "runs": len(options.runs),
        "stops": stops,
        "peaks": table(peaks),
    }
    result |= {"commands": peaks.commands, "changed": peaks.changed}
    print(json.dumps(result, indent=1) if options.json else text(options, result))
    return 1 if peaks.changed else 0


def read(folder: Path, robot: str, peaks: Peaks) -> None:
    """Add what a run's recording has of commands and joints.

    Raises:
        UsageError: there is no recording, it is of another robot, or it lacks joint targets.
    """
    recording, path = Recording.load(folder / "run.npz"), folder / "run.npz"
    task = load_task(recording.config["task"])
    if task.scene.robot.name != robot:
        raise UsageError(f"{path} is of {task.scene.robot.name}, not of {robot}")
    if not recording.targets:
        raise UsageError(f"{path} has no joint targets: nothing was sent, or it is too old")
    states = np.array(recording.states)
    model = compile_model(task.scene, PLANT)
    _, speeds = StateIndex(model).joints(task.scene.robot.joints)
    targets = np.array([task.scene.robot.stand, *recording.targets])
    changed = sum(recording.commands.get(why, 0) for why in ("non-finite", "position", "rate"))
    peaks.add(targets, states[:, speeds], changed)


def table(peaks: Peaks) -> list[list[float]]:
    """Round what `Peaks` has, one row a joint: low, high, rate, speed."""
    return np.stack([peaks.low, peaks.high, peaks.rate, peaks.speed], axis=1).round(2).tolist()


def text(options: Options, result: Mapping[str, Any]) -> str:
    """Lay out what was measured."""
    robot = ROBOTS[options.robot][0].robot
    rates = robot.safety.target_rate or (np.inf,) * len(robot.joints)
    rows = [
        (joint, f"{low:.2f}", f"{high:.2f}", f"{rate:.1f}", f"{limit:g}", f"{speed:.1f}")
        for joint, (low, high, rate, speed), limit in zip(
            robot.joints, result["peaks"], rates, strict=True
        )
    ]
    head = ("joint", "lowest [rad]", "highest [rad]", "rate [rad/s]", "limit", "speed [rad/s]")
    ends = [
        (name, *(f"{q:.2f}" for q in np.quantile([s[name] for s in result["stops"]], (0, 0.5, 1))))
        for name in result["stops"][0]
    ]
    return "\n\n".join(
        (
            heading(f"bench safety --robot {options.robot} --seed {options.seed}", result),
            f"{WALKS} walks of {WALK_S:g} s at random velocities and {result['runs']} recorded "
            f"runs: {result['commands']} commands, {result['changed']} changed by the guard. "
            f"Joint targets, how fast they changed, and the joints' speeds (a joint beyond "
            f"{robot.safety.joint_speed:g} rad/s stops the robot):",
            markdown(head, rows),
            f"{len(result['stops'])} safe stops out of the walks, watched for {WATCHED_S:g} s:",
            markdown(("of a stop", "least", "median", "most"), ends),
        )
    )
