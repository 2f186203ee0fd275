"""`sumo-dist bench optimizers`: every optimizer at every budget, on the same tasks and seeds."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from sumo_dist.bench.campaign.campaign import Settings
from sumo_dist.bench.campaign.cells import Cell, compare
from sumo_dist.errors import UsageError
from sumo_dist.optim import OPTIMIZERS


@dataclass(frozen=True, kw_only=True)
class Options(Settings):
    """Options of `bench optimizers`.

    Attributes:
        tasks: names of tasks, files or suites, separated by commas.
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
        return [Cell.of_budget(optimizer, n) for n in budgets for optimizer in optimizers]


def main(options: Options) -> int:
    """Run what the folder lacks and print the tables; 3 if a trial died or a fault ended it."""
    return compare(options, options.cells(), options.tasks, options.out, by_task=True)
