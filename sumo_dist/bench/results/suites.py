"""The suites of the benchmark: which tasks, and what has been published about them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple


class Figure(NamedTuple):
    """A published result of a task."""

    successes: int
    trials: int
    seconds: float | None = None  # mean completion time, where it was published

    @property
    def rate(self) -> float:
        """Share of successes."""
        return self.successes / self.trials

    def __str__(self) -> str:
        """Say it in a table: the rate, and the time if there is one."""
        time = "" if self.seconds is None else f", {self.seconds:.2f} s"
        return f"{self.rate:.2f}{time}"


@dataclass(frozen=True)
class Suite:
    """Tasks that are measured together, with the same settings.

    Attributes:
        name: on the command line.
        title: of its report.
        source: of the published figures.
        figures: by task, in the report's order.
        controls: the tasks in which an object might succeed by itself; of them, trials in which
            the robot only stands are run as well.
    """

    name: str
    title: str
    source: str
    figures: Mapping[str, Figure]
    controls: tuple[str, ...] = ()


_OBJECTS = ("box", "chair", "cone", "tire", "rack")

PAPER_ANALYSIS = Suite(
    name="paper-analysis",
    title="Spot moves and uprights five objects",
    source="the paper (arXiv:2604.08508), 20 trials a task",
    figures={
        f"spot/{family}_{thing}": Figure(successes, 20)
        for family, of_20 in {"move": (17, 19, 20, 20, 20), "upright": (20, 19, 20, 19, 19)}.items()
        for thing, successes in zip(_OBJECTS, of_20, strict=True)
    },
    controls=tuple(f"spot/upright_{thing}" for thing in _OBJECTS),
)

PAPER_G1 = Suite(
    name="paper-g1",
    title="G1 pushes a box, a chair and a table, and opens a door",
    source="the paper (arXiv:2604.08508), 10 trials a task in simulation, with mean times",
    figures={
        "g1/box_push": Figure(9, 10, 11.83),
        "g1/chair_push": Figure(10, 10, 6.86),
        "g1/door_open": Figure(10, 10, 4.73),
        "g1/table_push": Figure(8, 10, 4.86),
    },
)

_DEMONSTRATIONS = {
    "tire_upright": Figure(10, 10, 9.2),
    "barrier_upright": Figure(9, 10, 10.5),
    "cone_upright": Figure(9, 10, 10.2),
    "chair_upright": Figure(8, 10, 27.3),
    "tire_stack": Figure(8, 10, 16.5),
    "barrier_drag": Figure(9, 10, 20.2),
    "rack_drag": Figure(9, 10, 19.1),
    "box_push": Figure(10, 10, 38.3),
}

PAPER_SPOT = Suite(
    name="paper-spot",
    title="Spot's eight demonstrations",
    source="the paper (arXiv:2604.08508), 10 trials a task on the robot, with mean times",
    figures={f"spot/demo_{name}": figure for name, figure in _DEMONSTRATIONS.items()},
    controls=tuple(f"spot/demo_{name}" for name in _DEMONSTRATIONS),
)

SUITES = {suite.name: suite for suite in (PAPER_ANALYSIS, PAPER_SPOT, PAPER_G1)}
