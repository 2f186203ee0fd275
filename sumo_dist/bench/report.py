"""What the benches print: Markdown tables, intervals, and what machine it was."""

import math
import os
import platform
from collections.abc import Sequence

from sumo_dist.errors import UsageError
from sumo_dist.rollout import engine_identity

Z95 = 1.959964  # standard normal quantile of a two-sided 95 % interval


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Wilson's 95 % score interval of a success rate."""
    rate, z2 = successes / trials, Z95**2 / trials
    center = (rate + z2 / 2) / (1 + z2)
    half = Z95 / (1 + z2) * math.sqrt(rate * (1 - rate) / trials + z2 / (4 * trials))
    return max(0.0, center - half), min(1.0, center + half)


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out a Markdown table that also reads well as it is."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = [head, ["-" * width for width in widths], *rows]
    return "\n".join(
        f"| {' | '.join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))} |"
        for line in lines
    )


def cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def machine() -> str:
    """Processor, cores and system in one line."""
    return f"{_processor()}, {cores()} cores, {platform.system()} {platform.machine()}"


def checked_engine(kind: str) -> tuple[str, str]:
    """Return name and build of an engine; a bench takes the fallback only if asked for by name."""
    name, build = engine_identity(kind)
    if name == "fallback" and kind != "fallback":
        raise UsageError(
            "the native engine is not in this installation (it was built without a C++ compiler); "
            "to bench the other one, say --engine fallback"
        )
    return name, build


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as info:
            names = [line.partition(":")[2].strip() for line in info if "model name" in line]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or platform.machine()
