"""Options of the benches that repeat one task with many seeds."""

from dataclasses import dataclass

from sumo_dist.bench.layout import Result, check_at_least, checked_engine


@dataclass(frozen=True)
class SeedOptions:
    """Which task, and which seeds.

    Attributes:
        json: print one JSON object.
        task: what is done.
        trials: seeds of each row.
        seed0: the first seed.
    """

    json: bool = False
    task: str = "spot/move_box"
    trials: int = 5
    seed0: int = 1

    def __post_init__(self) -> None:
        check_at_least(1, trials=self.trials)

    @property
    def seeds(self) -> range:
        """The seeds of each row."""
        return range(self.seed0, self.seed0 + self.trials)

    def about(self) -> Result:
        """Return these options as the result has them, with the engine's name."""
        engine, _ = checked_engine("auto")
        return {"engine": engine, "task": self.task, "trials": self.trials, "seed0": self.seed0}
