"""The search: optuna says what to try next, and which trials are hopeless."""

import logging
import warnings
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import optuna
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.trial import TrialState

from sumo_dist.bench.tune.results import COMPLETE, PRUNED, RUNNING, Row, Tried, loss
from sumo_dist.bench.tune.space import Dimension, Space, Values
from sumo_dist.planner.ranges import Range

BEFORE_PRUNING = 5  # complete trials, whose median the others are compared with

optuna.logging.set_verbosity(logging.WARNING)


class Question(NamedTuple):
    """What is to be run next."""

    number: int  # of the trial
    values: Values
    seed: int
    asked: Mapping[str, Any]  # optuna's parameters, of which the values are made


class Search:
    """Says what to run, and takes what came of it. The same seed asks the same, run by run.

    The sampler starts anew from `seed` and the trial's number at each trial, so that a search that
    goes on after a kill asks what it would have asked.
    """

    def __init__(
        self,
        space: Space,
        seeds: Sequence[int],
        first: int,
        trials: int,
        seed: int,
        own: bool,
        found: Sequence[Tried] = (),
    ) -> None:
        """Go on from what was found.

        Args:
            space: what is searched.
            seeds: of each trial, in their order.
            first: seeds after which a trial may be pruned.
            trials: how many there are to be.
            seed: decides what is tried.
            own: try the task's own values first, where they are in their ranges.
            found: trials of the same search so far.
        """
        self._space, self._seeds, self._first = space, seeds, first
        self._trials, self._seed, self._own = trials, seed, own and space.has_start
        self._distributions = {d.name: _distribution(d.range) for d in space.dimensions}
        self._study = optuna.create_study(pruner=optuna.pruners.MedianPruner(BEFORE_PRUNING))
        self._asked = dict[int, _Asked]()
        self._waiting = deque[Question]()
        by_number = {trial.number: trial for trial in found}
        for number in range(max(by_number, default=-1) + 1):
            self._restore(by_number.get(number))

    def next(self) -> Question | None:
        """Return what to run next; None if nothing can be begun before something ends."""
        if not self._waiting and len(self._study.trials) < self._trials:
            self._begin()
        return self._waiting.popleft() if self._waiting else None

    def drop(self, question: Question) -> None:
        """Leave out a trial whose values cannot be together."""
        self._study.tell(self._asked.pop(question.number).trial, state=TrialState.FAIL)

    def take(self, question: Question, row: Row) -> str:
        """Take the row of a question; return the state of its trial after it."""
        asked = self._asked[question.number]
        asked.rows.append(row)
        if len(asked.rows) == len(self._seeds):
            self._study.tell(asked.trial, loss(asked.rows))
            state = COMPLETE
        elif self._is_hopeless(asked):
            self._study.tell(asked.trial, state=TrialState.PRUNED)
            state = PRUNED
        else:
            self._waiting.append(self._question(asked))
            return RUNNING
        del self._asked[question.number]
        return state

    def importances(self) -> dict[str, float]:
        """Return how much each dimension decides the loss of complete trials; 1 in sum.

        Empty where there is one dimension, or too few trials.
        """
        complete = self._study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
        if len(self._distributions) < 2 or len(complete) < 2 * BEFORE_PRUNING:
            return {}
        with _quiet():
            evaluator = optuna.importance.PedAnovaImportanceEvaluator()
            return optuna.importance.get_param_importances(self._study, evaluator=evaluator)

    def _begin(self, wanted: Mapping[str, Any] | None = None, rows: Sequence[Row] = ()) -> None:
        """Ask for a trial, of some parameters if they are known."""
        number = len(self._study.trials)
        if wanted is None and number == 0 and self._own:
            wanted = {d.name: _asked_for(d, d.range.default) for d in self._space.dimensions}
        if wanted is not None:
            self._study.enqueue_trial(dict(wanted))
        self._study.sampler = _sampler(self._seed, number)
        trial = self._study.ask(self._distributions)
        asked = self._asked[number] = _Asked(trial, self._values(trial), list(rows))
        self._report(asked)
        self._waiting.append(self._question(asked))

    def _restore(self, found: Tried | None) -> None:
        """Let the study have a trial of before; one that left no row is begun anew."""
        if found is None:
            self._begin()
        elif found.state == RUNNING:
            self._begin(found.rows[0]["asked"], found.rows)
        else:
            first = {self._first: loss(found.rows[: self._first])}
            self._study.add_trial(
                optuna.trial.create_trial(
                    state=TrialState.COMPLETE if found.state == COMPLETE else TrialState.PRUNED,
                    value=found.loss,
                    params=dict(found.rows[0]["asked"]),
                    distributions=self._distributions,
                    intermediate_values=first if self._first < len(self._seeds) else {},
                )
            )

    def _report(self, asked: "_Asked") -> bool:
        """Report the loss after the first seeds; return whether that is what there is now.

        Optuna compares the best report of a trial, and a loss of few seeds may be the best by luck:
        so there is one report, at the same number of seeds for all.
        """
        if self._first < len(self._seeds) and len(asked.rows) >= self._first:
            if not asked.reported:
                asked.trial.report(loss(asked.rows[: self._first]), self._first)
                asked.reported = True
            return len(asked.rows) == self._first
        return False

    def _is_hopeless(self, asked: "_Asked") -> bool:
        return self._report(asked) and asked.trial.should_prune()

    def _values(self, trial: optuna.Trial) -> Values:
        return {d.name: _tried(d, trial.params[d.name]) for d in self._space.dimensions}

    def _question(self, asked: "_Asked") -> Question:
        params = dict(asked.trial.params)
        return Question(asked.trial.number, asked.values, self._seeds[len(asked.rows)], params)


@dataclass
class _Asked:
    """A trial that is under way."""

    trial: optuna.Trial
    values: Values
    rows: list[Row]
    reported: bool = False


def _distribution(found: Range) -> BaseDistribution:
    """Return what optuna draws from; of a log range below 0, the magnitude."""
    if found.kind == "choice":
        return CategoricalDistribution(found.choices)
    if found.kind == "int":
        return IntDistribution(int(found.low), int(found.high), log=found.log)
    low, high = sorted(map(abs, (found.low, found.high))) if found.log else (found.low, found.high)
    return FloatDistribution(low, high, log=found.log)


def _asked_for(dimension: Dimension, value: Any) -> Any:
    """Return what optuna is told for a value."""
    is_magnitude = dimension.range.kind == "float" and dimension.range.log
    return abs(value) if is_magnitude else value


def _tried(dimension: Dimension, asked: Any) -> float | int | str:
    """Return the value that is tried for what optuna asked."""
    found = dimension.range
    return dimension.rounded(-asked if found.log and found.high < 0 else asked)


def _sampler(seed: int, number: int) -> optuna.samplers.TPESampler:
    """Return the sampler of a trial: a tree of Parzen estimators over all dimensions together."""
    own = int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
    with _quiet():  # trials that run beside it count as bad ones: no two try the same
        return optuna.samplers.TPESampler(seed=own, multivariate=True, constant_liar=True)


@contextmanager
def _quiet() -> Iterator[None]:
    """Without the warning that an option is new to optuna."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        yield
