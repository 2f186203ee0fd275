"""`sumo-dist task check`: is a task fit to be planned for, before hours are spent on it."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import mujoco
import numpy as np
import tyro

from sumo_dist.commands.doctor import Finding, examine
from sumo_dist.costs.terms import INDICATORS
from sumo_dist.costs.view import View, ViewLayout
from sumo_dist.episode.assemble import draw_start
from sumo_dist.errors import UsageError
from sumo_dist.math.rotations import from_rotation_vector, multiply
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model, remarks
from sumo_dist.model.settle import height_above_floor
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.rollout.interface import Engine
from sumo_dist.tasks import load_task
from sumo_dist.tasks.task import Task

# The task of the same robot whose planning time is 1.
REFERENCES = {"spot": "spot/move_box", "g1": "g1/box_push"}
COST_LIMIT = 1.5  # planning time of any task over the reference's
ROUNDS = 5  # plans that are timed, of each task in turn
ARENA = 20.0  # no start is farther from the origin [m]
OVERLAP = 0.005  # contacts of a start are no deeper [m]
NUDGES, PLANS = 4, 8  # starts with the objects tilted and set in motion, and plans from each
NUDGE = 0.5  # spread of the objects' speeds there [m/s, rad/s]
TILT = 0.2  # spread of their turn about each level axis there [rad]
SAY = 1e-4  # a term whose spread is a smaller part of the largest one's decides nothing
LARGEST = 1e6  # a weighted term beyond this has a weight or a unit that cannot be meant


@dataclass(frozen=True)
class Options:
    """Options of `task check`.

    Attributes:
        task: a name, or the path of a file that defines task() -> Task.
        seeds: how many starts are drawn.
    """

    task: Annotated[str, tyro.conf.Positional]
    seeds: int = 5


def main(options: Options) -> int:
    """Print the cost table and a line per check; 0 if all are ok, else 1."""
    if not 2 <= options.seeds <= 1000:
        raise UsageError(f"seeds must be from 2 to 1000, got {options.seeds}")
    subject = Subject(load_task(options.task), options.seeds)
    print(f"{subject.task}\n")
    failed = 0
    for name, check in CHECKS.items():
        finding = examine(lambda check=check: check(subject))
        verdict = "ok" if finding.level == "ok" else "FAIL"
        print(f"{verdict:<6}{name:<12}{finding.text}", flush=True)
        failed += finding.level != "ok"
        if failed and name in BASIC:
            print("the other checks need this one")
            break
    return 1 if failed else 0


class Subject:
    """A task under examination; what several checks look at is made once.

    Attributes:
        task: the task.
        seeds: how many starts are drawn.
        config: the planner's default settings.
    """

    def __init__(self, task: Task, seeds: int) -> None:
        """Take a task that loads."""
        self.task, self.seeds, self.config = task, seeds, PlannerConfig.resolve(task.planner)

    @cached_property
    def plant(self) -> mujoco.MjModel:
        """The plant's model."""
        return compile_model(self.task.scene, PLANT)

    @cached_property
    def problem(self) -> Problem:
        """What is planned for."""
        return Problem.build(self.task, planning_options(self.config))

    @cached_property
    def starts(self) -> list[np.ndarray]:
        """The start (nq + nv,) of each seed."""
        return [draw_start(self.task, seed) for seed in range(self.seeds)]

    @cached_property
    def terms(self) -> np.ndarray:
        """(seeds, NUDGES * PLANS, n_terms) weighted costs of random plans, objects nudged."""
        rng = np.random.default_rng(0)
        with self.problem.engine(1) as engine:
            evaluator = self.evaluator(engine)
            rows = [
                self.costs(evaluator, self.nudged(start, rng), self.knots(PLANS, rng))
                for start in self.starts
                for _ in range(NUDGES)
            ]
        return np.reshape(rows, (self.seeds, NUDGES * PLANS, -1))

    def evaluator(self, engine: Engine) -> Evaluator:
        """Return what rolls out and costs plans on an engine."""
        return Evaluator(self.problem, engine, self.config)

    def costs(self, evaluator: Evaluator, state: np.ndarray, knots: np.ndarray) -> np.ndarray:
        """(B, n_terms) weighted costs of knots (B, K, n) from a state, or from one each."""
        memory, cost = self.problem.policy.initial_memory(), self.task.table.defaults
        rollouts, physical = evaluator.roll_out(state, memory, knots)
        with np.errstate(all="ignore"):
            return cost.weights * evaluator.terms(rollouts, physical, cost.parameters)

    def nudged(self, start: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return a start with every object tilted and in motion, as high above the floor as it was.

        Untouched, most would not move at all, and no random plan topples what is heavy: terms about
        an object would look dead.
        """
        state, index = start.copy(), StateIndex(self.plant)
        qpos = state[: self.plant.nq]
        for body in index.free_bodies:
            if body == self.task.scene.robot.base:
                continue
            pose, height = qpos[index.pose(body)], height_above_floor(self.plant, qpos, body)
            turn = from_rotation_vector(np.array([*rng.normal(0.0, TILT, 2), 0.0]))
            pose[3:] = multiply(turn, pose[3:])
            pose[2] += height - height_above_floor(self.plant, qpos, body)
            state[index.velocity(body)] = rng.normal(0.0, NUDGE, 6)
        return state

    def knots(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Random knots (count, K, n)."""
        shape = count, self.config.nodes, self.task.actions.size
        return np.clip(rng.normal(0.0, 0.5, shape), -1.0, 1.0)

    def view(self, state: np.ndarray) -> View:
        """Name the arrays of one state."""
        layout = ViewLayout(self.plant, self.task.frames)
        table = self.task.table
        parameters = table.named(table.defaults.parameters)
        return layout.at(self.simulation(state), len(self.task.actions.names), parameters)

    def simulation(self, state: np.ndarray) -> mujoco.MjData:
        """Return the plant at a state, contacts included."""
        data = mujoco.MjData(self.plant)
        data.qpos[:], data.qvel[:] = np.split(state, [self.plant.nq])
        mujoco.mj_forward(self.plant, data)
        return data


def model(subject: Subject) -> Finding:
    """Do the scene's models compile, and does the policy fit the robot."""
    plant, planning = subject.plant, subject.problem.model
    objects = ", ".join(thing.name for thing in subject.task.scene.objects) or "no object"
    size = f"{subject.task.scene.robot.name}, {objects}: nq {plant.nq}, nv {plant.nv}"
    text = "; ".join([size, *remarks(subject.task.scene)])
    return _verdict(plant.nq == planning.nq, text, "plant and planning model differ in layout")


def frames(subject: Subject) -> Finding:
    """Are there all the sites and bodies that the task names."""
    known = {
        "site": {subject.plant.site(i).name for i in range(subject.plant.nsite)},
        "body": {subject.plant.body(i).name for i in range(subject.plant.nbody)},
    }
    missing = [
        f"{name} ({ref.kind} {ref.name!r})"
        for name, ref in subject.task.frames.items()
        if ref.name not in known.get(ref.kind, ())
    ]
    return _verdict(not missing, ", ".join(subject.task.frames), f"not in the model: {missing}")


def reset(subject: Subject) -> Finding:
    """Is every start reached, of the right shape, and decided by its seed."""
    size = subject.plant.nq + subject.plant.nv
    for seed, start in enumerate(subject.starts):
        if np.shape(start) != (size,):
            return Finding("fail", f"seed {seed}: shape {np.shape(start)}, must be ({size},)")
        if not np.array_equal(draw_start(subject.task, seed), start, equal_nan=True):
            return Finding("fail", f"seed {seed}: a second draw differs; draw from rng only")
    different = len({start.tobytes() for start in subject.starts})
    text = f"{subject.seeds} seeds, each drawn twice, {different} different starts"
    return _verdict(different > 1, text, "every seed has the same start")


def start(subject: Subject) -> Finding:
    """Is every start a state that the world can be in, the robot standing and untouched."""
    for seed, state in enumerate(subject.starts):
        if reason := _misplaced(subject, state):
            return Finding("fail", f"seed {seed}: {reason}")
    index = StateIndex(subject.plant)
    poses = [s[index.pose(body)] for s in subject.starts for body in index.free_bodies]
    reach = np.abs(poses)[:, :2].max()
    return Finding("ok", f"all within {reach:.1f} m, none in contact with the robot")


def _misplaced(subject: Subject, state: np.ndarray) -> str:
    """Say what is wrong with a start, if anything."""
    if not np.isfinite(state).all():
        return "not finite"
    index, robot = StateIndex(subject.plant), subject.task.scene.robot
    for body in index.free_bodies:
        pose = state[index.pose(body)]
        if np.abs(pose[:3]).max() > ARENA:
            return f"{body} is {np.abs(pose[:3]).max():.0f} m away; positions are in m"
        if abs(np.linalg.norm(pose[3:]) - 1.0) > 1e-6:
            return f"{body}'s quaternion has norm {np.linalg.norm(pose[3:]):.3g}, must be 1"
    if state[index.pose(robot.base)][2] <= robot.fall_height:
        return "the robot has fallen"
    data, root = subject.simulation(state), subject.plant.body(robot.base).id
    for contact in data.contact:
        geoms = [subject.plant.geom(i) for i in contact.geom]
        roots = {int(subject.plant.body_rootid[geom.bodyid[0]]) for geom in geoms}
        names = " and ".join(subject.plant.body(geom.bodyid[0]).name for geom in geoms)
        if contact.dist < -OVERLAP:
            return f"{names} overlap by {-contact.dist * 1e3:.0f} mm"
        if root in roots and not roots <= {root, 0}:
            return f"{names} touch"
    return ""


def unsolved(subject: Subject) -> Finding:
    """Is no start solved, and none a failure."""
    tests = {"success": subject.task.success, **subject.task.failure}
    for seed, state in enumerate(subject.starts):
        view = subject.view(state)
        for name, test in tests.items():
            held = np.asarray(test(view))
            if held.shape != (1, 1) or held.dtype != bool:
                return Finding(
                    "fail",
                    f"{name} returned shape {held.shape} of {held.dtype}, must be "
                    "(rollouts, steps) = (1, 1) of bool",
                )
            if held.any():
                return Finding("fail", f"seed {seed}: {name} holds at the start")
    return Finding("ok", f"no start has: {', '.join(tests)}")


def finite(subject: Subject) -> Finding:
    """Are all costs finite and of a size that can be meant."""
    for i, term in enumerate(subject.task.cost):
        values = subject.terms[:, :, i]
        if not np.isfinite(values).all():
            lost = np.count_nonzero(~np.isfinite(values))
            return Finding("fail", f"{term.name} is not finite in {lost} of {values.size} rollouts")
        if (largest := np.abs(values).max()) > LARGEST:
            return Finding("fail", f"{term.name} reaches {largest:.1e}: look at its weight or unit")
    means = zip(subject.task.cost, subject.terms.mean(axis=(0, 1)), strict=True)
    return Finding("ok", "mean " + ", ".join(f"{term.name} {mean:.3g}" for term, mean in means))


def sensitive(subject: Subject) -> Finding:
    """Does every term tell apart what may come of one start, and have a say in the sum."""
    spreads = subject.terms.std(axis=1).mean(axis=0)  # (n_terms,)
    idle = []
    for term, spread in zip(subject.task.cost, spreads, strict=True):
        if spread > SAY * spreads.max():
            continue
        if term.reduction not in INDICATORS:  # an indicator may well be of something rare
            return Finding(
                "fail",
                f"{term.name} varies by {spread:.1e} over nudges and random plans, others up to "
                f"{spreads.max():.1e}: it decides nothing",
            )
        idle.append(term.name)
    told = zip(subject.task.cost, spreads, strict=True)
    text = "spread " + ", ".join(f"{term.name} {spread:.3g}" for term, spread in told)
    return Finding("ok", text + (f"; not seen: {', '.join(idle)}" if idle else ""))


def split(subject: Subject) -> Finding:
    """Are the costs of a batch the same, bit for bit, when it is split."""
    rng = np.random.default_rng(1)
    jobs = [
        (subject.nudged(subject.starts[0], rng), subject.knots(PLANS, rng)) for _ in range(NUDGES)
    ]
    starts = np.repeat([state for state, _ in jobs], PLANS, axis=0)  # of every row of one batch
    with subject.problem.engine(1) as one, subject.problem.engine(2) as two:
        whole, parts = subject.evaluator(one), subject.evaluator(two)
        together = subject.costs(whole, starts, np.concatenate([knots for _, knots in jobs]))
        pieces = [
            subject.costs(parts, state, rows)
            for state, knots in jobs
            for rows in np.split(knots, [1, 3])
        ]
    apart = np.concatenate(pieces)
    same = (together == apart).all(axis=0)
    differing = [t.name for t, equal in zip(subject.task.cost, same, strict=True) if not equal]
    text = (
        f"{len(apart)} rollouts together, and in {len(pieces)} parts on another number of threads"
    )
    reason = f"{', '.join(differing)} depends on the other rows: avoid batched matrix products"
    return _verdict(not differing, text, reason)


def speed(subject: Subject) -> Finding:
    """How long a planning iteration takes, against the reference's."""
    reference = REFERENCES.get(subject.task.scene.robot.name, REFERENCES["spot"])
    pair = subject, Subject(load_task(reference), subject.seeds)
    times: tuple[list[float], list[float]] = [], []
    with pair[0].problem.engine(1) as ours, pair[1].problem.engine(1) as theirs:
        evaluators = [
            one.evaluator(engine) for one, engine in zip(pair, (ours, theirs), strict=True)
        ]
        for turn in range(ROUNDS):
            for one, evaluator, spent in zip(pair, evaluators, times, strict=True):
                knots = one.knots(one.config.rollouts, np.random.default_rng(turn))
                began = time.process_time()
                one.costs(evaluator, one.starts[turn % one.seeds], knots)
                spent.append(time.process_time() - began)
    ratio = statistics.median(times[0]) / statistics.median(times[1])
    text = f"a planning iteration takes {ratio:.2f} times that of {reference}"
    return _verdict(ratio <= COST_LIMIT, text, f"{text}, more than {COST_LIMIT:g}")


def _verdict(good: bool, text: str, reason: str) -> Finding:
    return Finding("ok", text) if good else Finding("fail", reason)


CHECKS: dict[str, Callable[[Subject], Finding]] = {
    "model": model,
    "frames": frames,
    "reset": reset,
    "start": start,
    "unsolved": unsolved,
    "finite": finite,
    "sensitive": sensitive,
    "split": split,
    "speed": speed,
}
BASIC = ("model", "frames", "reset")
