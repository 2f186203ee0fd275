"""What the benches of whole runs share: their options, and the command of one run."""

import sys
from dataclasses import dataclass

from sumo_dist.bench.layout import SeedOptions, check_at_least
from sumo_dist.errors import UsageError
from sumo_dist.provenance import cores

SAID = 2000  # characters of what a run that failed has said, the last ones


@dataclass(frozen=True)
class RunOptions(SeedOptions):
    """Options of the benches that make whole runs.

    Attributes:
        trials: runs of each kind.
        seconds: of robot time, at most, in each run.
        workers: worker processes of one thread each; by default one for each core.
    """

    seconds: float = 4.0
    workers: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_at_least(1, workers=self.workers)
        if not 0 < self.seconds <= 3600:
            raise UsageError(f"seconds must be in (0, 3600], got {self.seconds}")

    @property
    def processes(self) -> int:
        """Workers of a run."""
        return self.workers or cores()

    def command(self, seed: int, out: str, **given: object) -> list[str]:
        """Return the words that make one run by services, at a port of its own.

        Args:
            seed: of the run.
            out: its folder.
            given: other options of `sumo-dist run`, by name.
        """
        given = {
            "seed": seed,
            "time-limit": self.seconds,
            "workers": self.processes,
            "out": out,
            "listen": "tcp/127.0.0.1:0",
            **given,
        }
        flags = [
            f"--{name}" if value is True else f"--{name}={value}" for name, value in given.items()
        ]
        return [sys.executable, "-P", "-m", "sumo_dist", "run", self.task, *flags]
