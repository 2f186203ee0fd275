"""`sumo-dist bench optimizers`: every optimizer at every budget, on the same tasks and seeds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import NamedTuple

import tyro

from sumo_dist.bench.campaign.campaign import Campaign, Settings, make_folder
from sumo_dist.bench.layout import markdown
from sumo_dist.bench.results.journal import Trial
from sumo_dist.bench.results.outcomes import CELLS, Count, Row, count_tasks
from sumo_dist.errors import UsageError
from sumo_dist.optim import OPTIMIZERS
from sumo_dist.tasks import load_task
from sumo_dist.terminal import say


class Cell(NamedTuple):
    """What is compared: an optimizer, with the settings that suit it, at a budget."""

    optimizer: str
    budget: int  # rollouts a plan


@dataclass(frozen=True, kw_only=True)
class Options(Settings):
    """Options of `bench optimizers`.

    Attributes:
        tasks: names, separated by commas; `sumo-dist list` names all.
        out: folder that gets a journal per optimizer and budget; what was killed goes on from it.
        optimizers: names, separated by commas; by default all.
        budgets: rollouts a plan, separated by commas; an optimizer's iterations share them.
        trials: seeds per task, the same ones for every optimizer and budget.
    """

    tasks: str
    out: Path
    optimizers: str = ",".join(OPTIMIZERS)
    budgets: str = "16,32"
    trials: int = 10
    optimizer: tyro.conf.Suppress[str | None] = None  # it is --optimizers here

    def __post_init__(self) -> None:
        super().__post_init__()
        for setting in self.set:
            if setting.partition("=")[0] in ("optimizer", "rollouts"):
                raise UsageError(f"{setting}: say what to compare by --optimizers and --budgets")

    def cells(self) -> list[Cell]:
        """Return what to compare, in the order in which it is run."""
        try:
            budgets = dict.fromkeys(int(budget) for budget in self.budgets.split(","))
        except ValueError:
            raise UsageError(
                f"budgets must be whole numbers separated by commas, got {self.budgets!r}"
            ) from None
        optimizers = dict.fromkeys(self.optimizers.split(","))
        return [Cell(optimizer, budget) for budget in budgets for optimizer in optimizers]

    def of(self, cell: Cell) -> Settings:
        """Return the settings of a cell's trials."""
        shared = {field.name: getattr(self, field.name) for field in fields(Settings)}
        own = {"optimizer": cell.optimizer, "set": (*self.set, f"rollouts={cell.budget}")}
        return Settings(**{**shared, **own})


def main(options: Options) -> int:
    """Run what the folder lacks and print the table; 3 if a trial's process died."""
    tasks = dict.fromkeys(load_task(name).source for name in options.tasks.split(","))
    trials = [Trial(task, seed) for task in tasks for seed in options.seeds]
    make_folder(options.out)
    campaigns = {
        cell: Campaign(
            options.of(cell), trials, options.out / f"{cell.optimizer}-{cell.budget}.jsonl"
        )
        for cell in options.cells()
    }
    for cell, campaign in campaigns.items():
        say(f"{cell.optimizer}, {cell.budget} rollouts a plan:")
        campaign.run()
    print(table({cell: campaign.rows() for cell, campaign in campaigns.items()}))
    for campaign in campaigns.values():
        campaign.check_no_faults()
    return 0


def table(rows: Mapping[Cell, Sequence[Row]]) -> str:
    """Lay out the successes of every cell, task by task, and of all its tasks together."""
    head = ("optimizer", "rollouts", "task", *CELLS, "ended by")
    return markdown(head, [line for cell, found in rows.items() for line in _lines(cell, found)])


def _lines(cell: Cell, rows: Sequence[Row]) -> list[tuple[str, ...]]:
    counts = list(count_tasks(rows).values())
    if len(counts) > 1:
        counts.append(Count("all", rows))
    return [
        (cell.optimizer, str(cell.budget), count.task, *count.cells(), count.ended_by())
        for count in counts
    ]
