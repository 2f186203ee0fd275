"""The process in which libFuzzer works: `python -m ...measure.fuzz_guided CORPUS OUTCOMES`."""

import json
import logging
import sys
from pathlib import Path

import atheris  # pyright: ignore[reportMissingImports]  # an option: see bench.fuzz
import numpy as np

with atheris.instrument_imports(include=["sumo_dist"]):  # pyright: ignore
    from sumo_dist.bench.measure.fuzz_target import Target, samples
    from sumo_dist.faults.tamper import nonsense
    from sumo_dist.wire.codec import seal, unseal


def main() -> None:
    """Fuzz until the given number of runs; write the outcomes now and then and at the end."""
    corpus, outcomes, *settings = sys.argv[1:]
    runs = next(int(s.partition("=")[2]) for s in settings if s.startswith("-runs="))
    logging.disable(logging.CRITICAL)
    target = Target()
    for number, message in enumerate(samples(np.random.default_rng(0))):
        Path(corpus, f"seed-{number}").write_bytes(target.seed(message))
    seen = 0

    def one_input(data: bytes) -> None:
        nonlocal seen
        seen += 1
        target.feed(data)
        if seen % 10_000 == 0 or seen >= runs:
            Path(outcomes).write_text(json.dumps(target.outcomes))

    def mutate(data: bytes, max_size: int, seed: int) -> bytes:
        """Change a field half of the time: bytes alone would rarely leave a message whole."""
        if seed % 2 and len(data) > 1:
            try:
                changed = nonsense(seal(bytes(data[1:])), np.random.default_rng(seed))
                return (bytes(data[:1]) + unseal(changed))[:max_size]
            except Exception:  # what is no message is mutated as bytes
                pass
        return atheris.Mutate(data, max_size)

    atheris.Setup([sys.argv[0], corpus, *settings], one_input, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
