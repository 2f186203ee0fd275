"""`sumo-dist distil`: recorded runs of the planner become a policy that proposes plans."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.extras import need
from sumo_dist.learn.recordings import gather
from sumo_dist.provenance import provenance
from sumo_dist.terminal import say


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of `distil`.

    Attributes:
        runs: folders of recorded runs, or of such folders, as `bench suite --recordings all` leaves
            them; runs that did not succeed are left out.
        out: file of the policy, FILE.onnx: for `--set guidance=learned --set policy=FILE`.
        epochs: passes over the plans, at most.
        seed: of the fit; it decides every bit of the policy.
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    out: Path
    epochs: int = 60
    seed: int = 1

    def __post_init__(self) -> None:
        if self.out.suffix != ".onnx":
            raise UsageError(f"--out must end in .onnx, got {self.out}")
        if not 1 <= self.epochs <= 10000:
            raise UsageError(f"--epochs must be from 1 to 10000, got {self.epochs}")
        if not 0 <= self.seed < 2**31:
            raise UsageError(f"--seed must be from 0 to 2^31 - 1, got {self.seed}")


def main(options: Options) -> int:
    """Gather, fit, write."""
    need("train", "sumo-dist distil")
    if not options.runs:
        raise UsageError("name folders of recorded runs: sumo-dist distil RUNS --out FILE.onnx")
    from sumo_dist.learn.distil import DistilConfig, distil

    examples = gather(options.runs)
    counts = ", ".join(f"{name} {count}" for name, count in sorted(examples.tasks.items()))
    say(f"{len(examples.knots)} plans of successful runs: {counts}")
    began, cpu = time.perf_counter(), time.process_time()
    origin = {"distilled": examples.tasks, "plans": len(examples.knots), "seed": options.seed}
    fit = distil(examples, DistilConfig(epochs=options.epochs), options.seed, origin | provenance())
    say(
        f"epoch {fit.epoch} of {options.epochs}: held-out error {fit.error:.4f} of a variance "
        f"{fit.spread:.4f}; {time.perf_counter() - began:.0f} s, "
        f"{time.process_time() - cpu:.0f} CPU s"
    )
    try:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        fit.policy.save(options.out)
    except OSError as error:
        raise SumoError(f"cannot write to {options.out}: {error.strerror or error}") from None
    say(f"wrote {options.out}: --set guidance=learned --set policy={options.out}")
    return 0
