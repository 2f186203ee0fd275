"""What the benches print: Markdown tables, intervals, and what machine it was."""

import importlib.metadata
import math
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from sumo_dist.errors import UsageError
from sumo_dist.rollout import engine_identity

VERSIONS = ("sumo_dist", "mujoco", "python")
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


def provenance() -> dict[str, str]:
    """What decides a result: the code and the machine."""
    return {
        "sumo_dist": f"{importlib.metadata.version('sumo-dist')}{_commit()}",
        "mujoco": importlib.metadata.version("mujoco"),
        "python": platform.python_version(),
        "machine": machine(),
    }


def timing_provenance() -> dict[str, str]:
    """What a time must be read with: the code, the machine and its load now."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return {**provenance(), "load": load}


def heading(command: str, about: Mapping[str, str]) -> str:
    """Say which command made the tables below, of which code, on what machine."""
    versions = ", ".join(f"{key.replace('_', '-')} {about[key]}" for key in VERSIONS)
    machine = f"{about['machine']}, load average {about['load']} at the start"
    return f"# sumo-dist {command}\n\n{versions}; {machine}."


def checked_engine(kind: str) -> tuple[str, str]:
    """Return name and build of an engine; a bench takes the fallback only if asked for by name."""
    name, build = engine_identity(kind)
    if name == "fallback" and kind != "fallback":
        raise UsageError(
            "the native engine is not in this installation (it was built without a C++ compiler); "
            "to bench the other one, say --engine fallback"
        )
    return name, build


def _commit() -> str:
    """Name the commit where the package runs from a git checkout."""
    commit = _git("rev-parse", "--short", "HEAD")
    if commit is None:
        return ""
    clean = _git("diff", "--quiet", "HEAD", "--", ":/", ":(top,exclude)docs") is not None
    return f" (commit {commit})" if clean else f" (commit {commit} with changes)"


def _git(*args: str) -> str | None:
    try:
        done = subprocess.run(
            ("git", "-C", str(Path(__file__).parent), *args),
            capture_output=True,
            text=True,
            check=False,
        )
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as info:
            names = [line.partition(":")[2].strip() for line in info if "model name" in line]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or platform.machine()
