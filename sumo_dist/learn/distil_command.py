"""`sumo-dist distil`: recorded runs of the planner become a policy that proposes plans."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.extras import need
from sumo_dist.learn.recordings import gather
from sumo_dist.planner.learned import LearnedNetwork
from sumo_dist.provenance import provenance
from sumo_dist.terminal import say


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of `distil`.

    Attributes:
        runs: folders of recorded runs, or of such folders, as `bench suite --recordings all` leaves
            them; runs that did not succeed are left out.
        out: file of the policy, FILE.onnx: for `--set guidance=learned --set policy=FILE`.
        value: file for a value of states as well, FILE.onnx: what the plans from there on cost, for
            the task's cost as `sumo_dist.planner.value.with_value` has it.
        epochs: passes over the plans, at most.
        seed: of the fit; it decides every bit of the policy.
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    out: Path
    value: Path | None = None
    epochs: int = 30
    seed: int = 1

    def __post_init__(self) -> None:
        for name, path in (("out", self.out), ("value", self.value)):
            if path is not None and path.suffix != ".onnx":
                raise UsageError(f"--{name} must end in .onnx, got {path}")
        if not 1 <= self.epochs <= 10000:
            raise UsageError(f"--epochs must be from 1 to 10000, got {self.epochs}")
        if not 0 <= self.seed < 2**31:
            raise UsageError(f"--seed must be from 0 to 2^31 - 1, got {self.seed}")


def main(options: Options) -> int:
    """Gather, fit, write."""
    need("train", "sumo-dist distil")
    if not options.runs:
        raise UsageError("name folders of recorded runs: sumo-dist distil RUNS --out FILE.onnx")
    from sumo_dist.learn.distil import DistilConfig, distil, distil_value

    examples = gather(options.runs)
    counts = ", ".join(f"{name} {count}" for name, count in sorted(examples.tasks.items()))
    say(f"{len(examples.knots)} plans of successful runs: {counts}")
    origin = {"distilled": examples.tasks, "plans": len(examples.knots), "seed": options.seed}
    made = DistilConfig(epochs=options.epochs), options.seed, origin | provenance()
    value, fit = distil_value(examples, *made)
    say(f"value: {fit}")
    policy, fit = distil(examples, value, *made)
    say(f"policy: {fit}")
    _write(options.out, policy)
    say(f"wrote {options.out}: --set guidance=learned --set policy={options.out}")
    if options.value is not None:
        _write(options.value, value)
        say(f"wrote {options.value}: for with_value, see docs/guides/learning.md")
    return 0


def _write(path: Path, network: LearnedNetwork) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        network.save(path)
    except OSError as error:
        raise SumoError(f"cannot write to {path}: {error.strerror or error}") from None
