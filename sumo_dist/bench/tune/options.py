"""What `sumo-dist tune` is asked for."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from sumo_dist.bench.campaign.campaign import TrialSettings
from sumo_dist.bench.campaign.job import common_settings, task_settings
from sumo_dist.bench.layout import check_at_least, spelled
from sumo_dist.bench.tune.space import Space
from sumo_dist.errors import UsageError
from sumo_dist.planner.ranges import Range
from sumo_dist.record.folders import RUNS
from sumo_dist.tasks import load_task


@dataclass(frozen=True, kw_only=True)
class Options(TrialSettings):
    """Options of `tune`.

    Attributes:
        task: what to do: a name, or a file that defines task() -> Task.
        weights: weights to search, separated by commas, each from a tenth to ten times what it is.
        weight: weights of cost terms: a number, goal=80, for all trials, or a range to search,
            goal=20:180, on a log scale.
        param: the task's parameters: numbers for all trials, or a range to search, NAME=LOW:HIGH.
        set: planner settings: a value for all trials, or a range to search, rollouts=8:32, or
            choices, optimizer=ps:cem. In every range an end that is left out is the usual one.
        trials: how many to try.
        seeds: of each trial, such as 1-4 or 1,3,9.
        first: seeds after which a hopeless trial is given up; as many as there are seeds: never.
        seed: decides what is tried; with one job the same seed tries the same.
        start: the first trial is the task's own values, where the ranges have them (own), or drawn
            as all others (random).
        held_out: seeds on which the winner is compared with the task's own values in the end; none
            leaves that out.
        out: folder of the search, which the same command goes on with; by default one of the task
            below runs/.
        settings: file of weights, parameters and planner settings to start from.
        jobs: trials at a time in this machine's processes; by default one for each core.
    """

    task: Annotated[str, tyro.conf.Positional]
    weights: str = ""
    weight: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    param: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    trials: int = 50
    seeds: str = "1-4"
    first: int = 2
    seed: int = 0
    start: Literal["own", "random"] = "own"
    held_out: str = "101-110"
    out: Path | None = None
    settings: Path | None = None
    jobs: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_at_least(1, trials=self.trials)
        check_at_least(0, seed=self.seed)
        if not 1 <= self.first <= len(self.seeds_tried):
            raise UsageError(
                f"first must be from 1 to {len(self.seeds_tried)}, as there are so many seeds, "
                f"got {self.first}"
            )
        if both := sorted({*self.seeds_tried} & {*self.seeds_held_out}):
            raise UsageError(
                f"seeds {', '.join(map(str, both))} are both searched with and held out: what the "
                "winner was chosen by cannot tell how good it is"
            )

    @property
    def seeds_tried(self) -> list[int]:
        """The seeds of each trial."""
        return parse_seeds("seeds", self.seeds)

    @property
    def seeds_held_out(self) -> list[int]:
        """The seeds of the last comparison."""
        return [] if self.held_out == "none" else parse_seeds("held-out", self.held_out)

    @property
    def folder(self) -> Path:
        """The folder of the search."""
        return self.out or Path(RUNS, f"tune-{load_task(self.task).name.replace('/', '_')}")

    def space(self) -> Space:
        """Return what is searched, checked."""
        names = [name.strip() for name in self.weights.split(",") if name.strip()]
        plain = {f.name: getattr(self, f.name) for f in fields(TrialSettings)}
        return Space.of(load_task(self.task), TrialSettings(**plain), names)

    def request(self, space: Space) -> dict[str, Any]:
        """Return what the folder keeps of what was asked for."""
        episode = space.fixed.episode(space.task.source, 0)
        dimensions = {d.name: _range(d.range) for d in space.dimensions}
        decides = {
            "task": space.task.source,
            "searched": dimensions,
            **{key: getattr(self, key) for key in ("first", "seed", "start")},
            "seeds": self.seeds_tried,
            **common_settings(episode),
            **task_settings(episode),
        }
        about = {"held_out": self.seeds_held_out, "trials": self.trials}
        return {"command": self.line, "task": space.task.name, **about, "decides": decides}

    @property
    def line(self) -> str:
        """The command line that asks for the same."""
        return spelled("tune", self, "task")


def parse_seeds(name: str, text: str) -> list[int]:
    """Read seeds such as 1-4 or 1,3,9-11.

    Raises:
        UsageError: it is not of that form, or a seed comes twice.
    """
    found = list[int]()
    try:
        for part in text.split(","):
            first, dash, last = part.partition("-")
            ends = int(first), int(last if dash else first)
            if not 0 <= ends[0] <= ends[1] < ends[0] + 10_000:
                raise ValueError
            found += range(ends[0], ends[1] + 1)
    except ValueError:
        found = []
    if not found or len({*found}) < len(found):
        raise UsageError(f"{name} must be different seeds such as 1-4 or 1,3,9, got {text!r}")
    return found


def _range(found: Range) -> dict[str, Any]:
    """Return what decides of a range, and what the value is without a search."""
    if found.kind == "choice":
        return {"choices": list(found.choices), "own": found.default}
    return {"low": found.low, "high": found.high, "log": found.log, "own": found.default}
