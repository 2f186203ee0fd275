"""Cells: planner settings with a name, which are compared on the same tasks and seeds."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple, Self

from sumo_dist.bench.campaign.campaign import Campaign, Settings, make_folder, named_tasks
from sumo_dist.bench.results.journal import Trial
from sumo_dist.bench.results.success_cost import text
from sumo_dist.errors import UsageError, unknown
from sumo_dist.optim import OPTIMIZERS
from sumo_dist.wire.keys import checked_name

BUDGETS = (8, 16, 32)  # of the cells that are named after an optimizer and a budget
FORM = "NAME: key=value,key=value"


class Cell(NamedTuple):
    """Settings that are compared with others.

    Attributes:
        name: of its journal and its lines.
        settings: of the planner, as texts by key, over those of all cells; `preset` is one too,
            and `optimizer` brings what suits it.
    """

    name: str
    settings: Mapping[str, str]

    @classmethod
    def of_budget(cls, optimizer: str, rollouts: int) -> Self:
        """Return the cell of an optimizer at so many rollouts a plan."""
        settings = {"optimizer": optimizer, "rollouts": str(rollouts)}
        return cls(f"{optimizer}-{rollouts}", settings)

    @classmethod
    def parse(cls, given: str) -> Self:
        """Read a cell of the form FORM.

        Raises:
            UsageError: it is not of that form, or its name is another cell's.
        """
        name, _, listed = given.partition(":")
        name = checked_name("cell", name.strip())
        if name in NAMED:
            raise UsageError(f"cell {name} has settings of its own; give yours another name")
        settings = dict[str, str]()
        for setting in listed.split(","):
            key, equals, value = (part.strip() for part in setting.partition("="))
            if not equals:
                raise UsageError(f"cell {name}: {setting!r} is not key=value, as in {FORM!r}")
            if key in settings:
                raise UsageError(f"cell {name}: {key} is given twice; once is valid")
            settings[key] = value
        return cls(name, settings)

    def over(self, shared: Settings) -> Settings:
        """Return the settings of its trials, from those of all cells.

        Raises:
            UsageError: a setting is both of all cells and its own.
        """
        given, own = {field.name: getattr(shared, field.name) for field in fields(Settings)}, []
        for setting in shared.set:
            if setting.partition("=")[0] in self.settings:
                raise UsageError(f"--set {setting} is for all cells, and {self.name} has its own")
        for key, value in self.settings.items():
            if key in ("preset", "optimizer"):
                given[key] = value
            else:
                own.append(f"{key}={value}")
        return Settings(**{**given, "set": (*shared.set, *own)})


# The released code (rai-opensource/sumo) keeps Spot's noise between 0.1 and 1.0 in the units of the
# actions. In ours, where 1 is half the range (0.92 rad of an arm joint, geometric mean, and 0.7 of
# a base velocity), that is 0.11 to 1.08 for the arm and 1.32 times as much for the base. That code
# also fits its noise to the elites, plan after plan, within these bounds; here it is a fixed ramp.
REFERENCE = {
    "preset": "paper",
    "horizon": "2.0",
    "rollouts": "24",
    "nodes": "3",
    "variance_first": "0.0117",
    "variance_last": "1.17",
    "base_noise": "1.32",
}
NAMED = {
    cell.name: cell
    for cell in (
        Cell("default", {"preset": "default"}),
        Cell("paper", {"preset": "paper"}),
        Cell("reference", REFERENCE),
        *(Cell.of_budget(optimizer, n) for n in BUDGETS for optimizer in OPTIMIZERS),
    )
}


def parse_cells(texts: Iterable[str]) -> list[Cell]:
    """Read cells: names separated by commas, or one of the form FORM.

    Raises:
        UsageError: there is no cell of a name, or one is given twice.
    """
    cells = dict[str, Cell]()
    for given in texts:
        names = [name.strip() for name in given.split(",")]
        for cell in [Cell.parse(given)] if ":" in given else [named(name) for name in names]:
            if cell.name in cells:
                raise UsageError(f"cell {cell.name} is given twice; every cell needs its own name")
            cells[cell.name] = cell
    return [*cells.values()]


def named(name: str) -> Cell:
    """Return the cell that has a name of its own."""
    if name not in NAMED:
        raise unknown("cell", name, [*NAMED, repr(FORM)])
    return NAMED[name]


def compare(settings: Settings, cells: Sequence[Cell], tasks: str, out: Path, by_task: bool) -> int:
    """Run what a folder lacks and print the tables.

    Args:
        settings: of all cells.
        cells: what is compared.
        tasks: see `named_tasks`.
        out: folder that gets a journal per cell.
        by_task: print a table of each task as well.

    Returns:
        0.

    Raises:
        SumoError: a trial's process died or a fault ended it.
    """
    names = named_tasks(tasks)
    trials = [Trial(task, seed) for seed in settings.seeds for task in names]
    make_folder(out)
    campaigns = [_campaign(cell, settings, trials, out) for cell in cells]
    Campaign.run_together(campaigns)
    about = {cell.name: ", ".join(f"{k}={v}" for k, v in cell.settings.items()) for cell in cells}
    print(text({campaign.name: campaign.rows() for campaign in campaigns}, about, by_task))
    for campaign in campaigns:
        campaign.check_no_faults()
    return 0


def _campaign(cell: Cell, settings: Settings, trials: Sequence[Trial], out: Path) -> Campaign:
    try:
        return Campaign(cell.over(settings), trials, out / f"{cell.name}.jsonl", cell.name)
    except UsageError as error:
        raise UsageError(f"cell {cell.name}: {error}") from None
