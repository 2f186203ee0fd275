"""`sumo-dist bench fuzz`: bytes that nobody would send, to every message handler.

Coverage-guided by Atheris (libFuzzer) where that is installed, `pip install atheris`; else valid
messages changed at random. The inputs are sealed with a right checksum: without one they would all
end there.
"""

import json
import logging
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from sumo_dist.bench.layout import heading, markdown
from sumo_dist.errors import SumoError, UsageError, unknown
from sumo_dist.provenance import timing_provenance

FUZZERS = ("auto", "atheris", "random")


@dataclass(frozen=True)
class Options:
    """Options of `bench fuzz`.

    Attributes:
        json: print one JSON object.
        inputs: how many.
        fuzzer: atheris (coverage-guided), random, or auto: the first if it is installed.
        seed: of both.
    """

    json: bool = False
    inputs: int = 1_000_000
    fuzzer: str = "auto"
    seed: int = 1

    def __post_init__(self) -> None:
        if self.fuzzer not in FUZZERS:
            raise unknown("fuzzer", self.fuzzer, FUZZERS)
        if self.inputs < 1:
            raise UsageError(f"inputs must be at least 1, got {self.inputs}")
        if self.fuzzer == "atheris" and find_spec("atheris") is None:
            raise UsageError("atheris is not installed: pip install atheris, or --fuzzer random")


def main(options: Options) -> int:
    """Fuzz and print what became of the inputs; an error that no handler may raise ends it."""
    about, began = timing_provenance(), time.monotonic()
    guided = options.fuzzer == "atheris" or (
        options.fuzzer == "auto" and find_spec("atheris") is not None
    )
    outcomes = by_coverage(options) if guided else at_random(options)
    result = {
        **about,
        "fuzzer": "atheris" if guided else "random",
        "seed": options.seed,
        "inputs": sum(outcomes.values()),
        "seconds": round(time.monotonic() - began, 1),
        "outcomes": dict(outcomes.most_common()),
    }
    print(json.dumps(result, indent=1) if options.json else text(result))
    return 0


def at_random(options: Options) -> Counter[str]:
    """Feed mutations of valid messages."""
    from sumo_dist.bench.measure.fuzz_target import Target, samples
    from sumo_dist.faults.tamper import garbage, nonsense
    from sumo_dist.wire.codec import seal, unseal

    logging.disable(logging.ERROR)
    rng, target = np.random.default_rng(options.seed), Target()
    seeds = [target.seed(message) for message in samples(rng)]
    for _ in range(options.inputs):
        seed = seeds[rng.integers(len(seeds))]
        tamper = nonsense if rng.random() < 0.7 else garbage
        payload = seal(seed[1:])
        changed = tamper(payload, rng)
        target.feed(seed[:1] + (unseal(changed) if tamper is nonsense else changed[4:]))
    return target.outcomes


def by_coverage(options: Options) -> Counter[str]:
    """Run libFuzzer in a process of its own, which it ends itself."""
    with tempfile.TemporaryDirectory() as folder:
        outcomes = Path(folder, "outcomes.json")
        command = [
            sys.executable,
            "-m",
            "sumo_dist.bench.measure.fuzz_guided",
            folder,
            str(outcomes),
        ]
        settings = [f"-runs={options.inputs}", f"-seed={options.seed}", "-max_len=8192"]
        done = subprocess.run(
            [*command, *settings], check=False, capture_output=True, text=True, cwd=folder
        )
        if done.returncode != 0 or not outcomes.exists():
            raise SumoError(f"the fuzzer found something:\n{done.stderr[-4000:]}")
        return Counter(json.loads(outcomes.read_text()))


def text(result: dict[str, Any]) -> str:
    """Lay out what became of the inputs."""
    rows = [(name, f"{count}") for name, count in result["outcomes"].items()]
    return "\n\n".join(
        (
            heading("bench fuzz", result),
            f"{result['inputs']} inputs to the message handlers of robot, optimizer, estimator and "
            f"worker, by {result['fuzzer']} with seed {result['seed']}, in {result['seconds']:g} "
            "s. None raised what it may not; every accepted one is a valid message that encodes "
            "again to what it was. By what became of them:",
            markdown(("outcome", "inputs"), rows),
        )
    )
