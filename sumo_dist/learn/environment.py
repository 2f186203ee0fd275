"""Many episodes of a task at once, as a learner sees them: observe, act, be rewarded.

All of it is the planner's: rows of one rollout engine on the planning model and its variations,
the task's action space, cost terms, success and starts. A reward is by how much an action lowers
the task's cost, so their sum is the cost that the robot took away. How a robot should move, such as
in a gait, is nothing that can be taken away: such terms are paid for as long as they last.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np

from sumo_dist.costs.table import CostSettings
from sumo_dist.costs.terms import CostTerm
from sumo_dist.costs.view import View
from sumo_dist.errors import unknown
from sumo_dist.learn.starts import Starts
from sumo_dist.model.variation import Spread, draw
from sumo_dist.planner.observation import Observer
from sumo_dist.planner.problem import Problem
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.timing import PLAN_RATE, TICK, TICK_RATE, anchor_tick

COST_UNIT = 10.0  # cost that a reward of 1 takes away: sums over an episode are then about 10


@dataclass(frozen=True)
class EnvironmentConfig:
    """How episodes are drawn and cut.

    Attributes:
        count: B, episodes at a time.
        rate: actions per second of robot time [Hz].
        time_limit: of an episode [s].
        starts: S, in the store of starts.
        models: variations of the model among which episodes are spread, besides the model itself.
        spread: of the variations.
        scatter: up to how far starts are moved on the floor, see `Starts` [m].
        running: cost terms that are paid per second; of the others, what they change by.
    """

    count: int = 512
    rate: int = PLAN_RATE
    time_limit: float = 30.0
    starts: int = 1024
    models: int = 0
    spread: Spread = field(default_factory=Spread)
    scatter: float = 0.0
    running: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What follows from one action of each episode; one that ended has begun anew.

    Attributes:
        observations: (B, size) float32, of the states now.
        rewards: (B,).
        ended: (B,) bool, the episode is over, for whatever reason.
        timed_out: (B,) bool, it is over since its time was up.
        solved: (B,) bool, it ended in success.
        fell: (B,) bool, it ended since a term that counts once held, or its rollout diverged.
        cost: (B,) the task's cost where each episode was when the action had ended, without its
            running terms.
    """

    observations: np.ndarray
    rewards: np.ndarray
    ended: np.ndarray
    timed_out: np.ndarray
    solved: np.ndarray
    fell: np.ndarray
    cost: np.ndarray


@dataclass
class _Rows:
    """Where the episodes are.

    Attributes:
        states: (B, nq + nv).
        memory: (B, nm) float32, of the low-level policy.
        models: (B,) numbers of their models.
        age: (B,) ticks since the start.
        held: (B,) ticks for which success has held since it came about; -1 where it does not hold.
        cost: (B,) as of `Outcome`; NaN at a start, which no action led to.
    """

    states: np.ndarray
    memory: np.ndarray
    models: np.ndarray
    age: np.ndarray
    held: np.ndarray
    cost: np.ndarray


class Environment:
    """Episodes of one task; a context manager. Seed and actions decide every bit of it."""

    def __init__(
        self,
        problem: Problem,
        cost: CostSettings,
        config: EnvironmentConfig,
        seed: int,
        threads: int,
        engine: str = "auto",
    ) -> None:
        """Draw models and starts, and begin.

        Args:
            problem: the task, compiled.
            cost: weights and parameters.
            config: how episodes are drawn.
            seed: of all that is drawn; the starts are those of `run` with seeds from this one on.
            threads: of the rollouts.
            engine: kind of engine, see `make_engine`.

        Raises:
            UsageError: a running term is none of the task's, or one that counts once.
        """
        self._problem, self._cost, self.config = problem, cost, config
        self._once, self._running = _kinds(problem.task.cost, config.running)
        self._rng = np.random.default_rng(seed)
        models = tuple(draw(problem.model, config.spread, self._rng) for _ in range(config.models))
        seeds = range(seed, seed + config.starts)
        self._starts = Starts(problem, seeds, cost.parameters, models, config.scatter)
        self._engine = problem.engine(threads, engine, models)
        self._parameters = problem.task.table.named(cost.parameters)
        self._observer = Observer(problem.task, problem.model)
        self._anew = problem.policy.initial_memory()
        self._action = 0  # number of the next action, the same of all episodes
        task = problem.task
        self._hold = round(task.success_hold / TICK)
        self._rows = self._begin(config.count)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.close()

    @property
    def actions(self) -> ActionSpace:
        """The task's; those of `step` are what is searched of them, normalised."""
        return self._problem.task.actions

    def observe(self) -> np.ndarray:
        """Return the observations (B, size), float32."""
        return self._observer(self._rows.states, self._parameters)

    def stagger(self) -> None:
        """Let the first episodes end at different times, that not all are in the same phase."""
        limit = round(self.config.time_limit * TICK_RATE)
        self._rows.age = self._rng.integers(limit, size=self.config.count)

    def step(self, actions: np.ndarray) -> Outcome:
        """Follow normalised actions (B, n), clipped to [-1, 1], until the next ones are due."""
        rows, config = self._rows, self.config
        begin, end = (anchor_tick(self._action + k, config.rate) for k in (0, 1))
        self._action = (self._action + 1) % config.rate  # a second has whole actions
        space = self.actions
        steady = np.repeat(np.clip(actions, -1.0, 1.0)[:, None], end - begin, axis=1)  # (B, T, n)
        physical = space.physical(steady)
        rollouts = self._engine.rollout(
            rows.states, rows.memory, space.to_command(physical), rows.models
        )
        view = self._problem.layout.view(
            *(rollouts.states, rollouts.targets, rollouts.positions, rollouts.rotations, physical),
            self._parameters,
        )
        with np.errstate(invalid="ignore", over="ignore"):
            cost, running, fell = self._judge(view)
            held = self._held(self._problem.task.success(view), rollouts.valid)
        fell |= ~rollouts.valid | ~np.isfinite(cost + running)
        solved = (held >= self._hold) & ~fell
        age = rows.age + end - begin
        timed_out = (age >= config.time_limit * TICK_RATE) & ~solved & ~fell
        rewards = self._rewards(cost, running * (end - begin) * TICK, solved, fell)
        self._rows = _Rows(rollouts.states[:, -1], rollouts.memory, rows.models, age, held, cost)
        ended = solved | fell | timed_out
        self._renew(ended)
        return Outcome(self.observe(), rewards, ended, timed_out, solved, fell, cost)

    def state(self) -> dict[str, Any]:
        """Return all that `restore` needs to go on as if nothing had been between."""
        rows = {f.name: getattr(self._rows, f.name) for f in fields(_Rows)}
        return {"rows": rows, "action": self._action, "rng": self._rng.bit_generator.state}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` returned in an environment that was made alike."""
        self._rows, self._action = _Rows(**state["rows"]), state["action"]
        self._rng.bit_generator.state = state["rng"]

    def _judge(self, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cost (B,) at the last tick of a view, that of running terms, and whether it fell."""
        courses = np.stack([term.course(view) for term in self._problem.task.cost])  # (n, B, T)
        weighed = self._cost.weights[:, None, None] * courses
        cost = weighed[~(self._once | self._running), :, -1].sum(axis=0)
        running = weighed[self._running].mean(axis=2).sum(axis=0)
        fell = courses[self._once].max(axis=(0, 2), initial=0.0) > 0.0
        return cost, running, fell

    def _held(self, success: np.ndarray, valid: np.ndarray) -> np.ndarray:
        """Ticks for which success has held, (B,), after some more (B, T); it stays once solved."""
        held = self._rows.held
        for tick in range(success.shape[1]):
            goes_on = (success[:, tick] & valid) | (held >= self._hold)
            held = np.where(goes_on, held + 1, -1)
        return held

    def _rewards(
        self, cost: np.ndarray, paid: np.ndarray, solved: np.ndarray, fell: np.ndarray
    ) -> np.ndarray:
        """By how much the cost fell, (B,), less what running terms cost in this action, `paid`.

        If solved it fell to 0; a fall is all that counts once, and nothing else.
        """
        before = np.where(np.isnan(self._rows.cost), cost, self._rows.cost)
        after = np.where(solved, 0.0, cost)
        once = float(self._cost.weights[self._once].sum())
        rewards = np.where(fell, -once, before - after - paid)
        return np.nan_to_num(rewards, nan=-once) / COST_UNIT

    def _renew(self, ended: np.ndarray) -> None:
        """Begin anew what has ended, (B,) bool."""
        places = np.flatnonzero(ended)
        anew = self._begin(len(places))
        for f in fields(_Rows):
            getattr(self._rows, f.name)[places] = getattr(anew, f.name)

    def _begin(self, count: int) -> _Rows:
        states, models = self._starts.draw(count, self._rng)
        none = np.zeros(count, int)
        memory = np.tile(self._anew, (count, 1))
        return _Rows(states, memory, models, none, none - 1, np.full(count, np.nan))


def _kinds(terms: Sequence[CostTerm], running: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Which of a task's terms count once, and which are paid per second, (n,) bool each."""
    once = np.array([term.reduction == "any" for term in terms])
    names = [term.name for term, counts_once in zip(terms, once, strict=True) if not counts_once]
    for name in running:
        if name not in names:
            raise unknown("running term", name, names)
    return once, np.array([term.name in running for term in terms])
