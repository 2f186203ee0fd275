"""The problems that a worker has compiled: of its last few tasks, and only of those it may run."""

import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self, TypeVar

from sumo_dist.errors import SumoError
from sumo_dist.model.scene import ModelOptions
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation, Evaluator
from sumo_dist.planner.problem import Problem
from sumo_dist.rollout.interface import Engine
from sumo_dist.tasks import load_task

KEPT = 4  # problems with their engines; each has some MB and threads that sleep
CONFIGS = 4  # planner settings of a problem that evaluators are kept for
ASKERS = 8  # whose newest plan's answers are kept, in case they are asked for again
RETRY_S = 2.0  # a task whose files differ from the asker's is not compiled again for this long

K = TypeVar("K")
V = TypeVar("V")

Plan = tuple[str, int, int, PlannerConfig]
"""Run, number, iteration and settings."""
Answers = dict[bytes, tuple[Evaluation, float]]
"""By content of the question: costs, and the wall time that they took [ms]."""


class Compiled:
    """A problem, its engine, and what was asked of it last."""

    def __init__(self, problem: Problem, engine: Engine) -> None:
        """Start with nothing asked."""
        self.problem, self.engine = problem, engine
        self._evaluators: OrderedDict[PlannerConfig, Evaluator] = OrderedDict()
        self._answers: OrderedDict[str, tuple[Plan, Answers]] = OrderedDict()

    def evaluator(self, config: PlannerConfig) -> Evaluator:
        """Return what rolls out under some settings."""
        if config not in self._evaluators:
            self._evaluators[config] = Evaluator(self.problem, self.engine, config)
        _shorten(self._evaluators, config, CONFIGS)
        return self._evaluators[config]

    def answers(self, asker: str, plan: Plan) -> Answers:
        """Return what was answered so far to an asker of its newest plan; more is to be added."""
        if asker not in self._answers or self._answers[asker][0] != plan:
            self._answers[asker] = plan, {}
        _shorten(self._answers, asker, ASKERS)
        return self._answers[asker][1]


class CompiledProblems:
    """Problems by task, model and hash; a context manager."""

    def __init__(self, threads: int, engine: str, trust: Sequence[Path]) -> None:
        """Start with none.

        Args:
            threads: of each one's engine.
            engine: kind of it, see rollout.make_engine.
            trust: task files that may be run, and folders of such.
        """
        self._threads, self._kind, self._trust = threads, engine, trust
        self._kept: OrderedDict[tuple[str, ModelOptions, str], Compiled] = OrderedDict()
        self._differs: dict[tuple[str, ModelOptions, str], tuple[float, str]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for compiled in self._kept.values():
            compiled.engine.close()
        self._kept.clear()

    def get(self, task: str, options: ModelOptions, wanted: str) -> Compiled:
        """Return a task's problem of some hash; compile it if it is not here.

        Raises:
            SumoError: the task may not be run here, or it is another one here.
        """
        _check_trusted(task, self._trust)
        key = task, options, wanted
        if key not in self._kept:
            self._check_differs(key)
            self._compile(key)
        _shorten(self._kept, key, KEPT, lambda compiled: compiled.engine.close())
        return self._kept[key]

    def _check_differs(self, key: tuple[str, ModelOptions, str]) -> None:
        """Refuse what was refused a moment ago: who asks again must not cost a compilation."""
        at, reason = self._differs.get(key, (0.0, ""))
        if reason and time.monotonic() < at + RETRY_S:
            raise SumoError(reason)

    def _compile(self, key: tuple[str, ModelOptions, str]) -> None:
        task, options, wanted = key
        problem = Problem.build(load_task(task), options)
        if problem.hash != wanted:
            reason = (
                f"its {task} has hash {problem.hash}, the optimizer's has {wanted}: the task's "
                "files differ between the hosts"
            )
            now = time.monotonic()
            self._differs = {k: d for k, d in self._differs.items() if now < d[0] + RETRY_S}
            self._differs[key] = now, reason
            raise SumoError(reason)
        self._kept[key] = Compiled(problem, problem.engine(self._threads, self._kind))


def _shorten(
    kept: OrderedDict[K, V], used: K, most: int, close: Callable[[V], None] = lambda _: None
) -> None:
    """Note that one was used; close and forget those that were not for longest."""
    kept.move_to_end(used)
    while len(kept) > most:
        close(kept.popitem(last=False)[1])


def _check_trusted(task: str, trust: Sequence[Path]) -> None:
    """Refuse to run a file that a message names, unless this host was told to trust it."""
    if not task.endswith(".py"):
        return
    path = Path(task).resolve()
    if not any(path.is_relative_to(allowed.resolve()) for allowed in trust):
        raise SumoError(
            f"task file {path} is not trusted on this host: start the worker with "
            f"--trust {path.parent}"
        )
