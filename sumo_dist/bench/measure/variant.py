"""Variants of one workload, timed in turn, so that what disturbs one disturbs all alike."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

T = TypeVar("T")


class Variant(NamedTuple):
    """What is rolled out how."""

    engine: str  # "engine", "physics only", "fallback" or "reference"
    density: float  # of the fluid [kg/m^3]
    timestep: float  # of the physics [s]
    lean: bool = False  # without what model.departures leaves out

    def __str__(self) -> str:
        """Name it in a table."""
        lean = ", lean" if self.lean else ""
        return f"{self.engine}, density {self.density:g}, dt {self.timestep:g}{lean}"


class Round(NamedTuple):
    """One timed call."""

    wall_ms: float
    cpu_ms: float  # of all threads of the process
    final: np.ndarray  # (B, nq + nv) states at the end of the rollouts; NaN where they diverged


def timed(call: Callable[[], T]) -> tuple[float, float, T]:
    """Wall time and processor time of all threads [ms], and what the call returned."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = call()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    _wait_until_idle()
    return wall * 1e3, cpu * 1e3, result


def interleave(
    variants: Mapping[Variant, Callable[[], Round]], repeats: int, tell: Callable[[str], None]
) -> dict[Variant, list[Round]]:
    """Run all variants once to warm up, then in turn, each time another one first."""
    order = list(variants)
    rounds: dict[Variant, list[Round]] = {variant: [] for variant in variants}
    for variant in order:
        variants[variant]()
    for repeat in range(repeats):
        for i in range(len(order)):
            variant = order[(repeat + i) % len(order)]
            rounds[variant].append(variants[variant]())
        if (repeat + 1) % 10 == 0:
            tell(f"{repeat + 1} of {repeats} rounds")
    return rounds


def row(variant: Variant, rounds: Sequence[Round]) -> dict[str, Any]:
    """Median and minimum of a variant's rounds [ms]."""
    found = variant._asdict()
    for clock in ("wall_ms", "cpu_ms"):
        times = [getattr(each, clock) for each in rounds]
        found[f"{clock}_median"] = round(float(np.median(times)), 2)
        found[f"{clock}_min"] = round(min(times), 2)
    return {**found, "diverged": int((~np.isfinite(rounds[-1].final).all(axis=1)).sum())}


def _wait_until_idle() -> None:
    """Wait until the threads of this process are idle.

    Those of a BLAS spin on for 0.1 s after a call, which would be charged to the next one.
    """
    busy = True
    while busy:
        before = time.process_time()
        time.sleep(0.01)
        busy = time.process_time() - before > 0.001
