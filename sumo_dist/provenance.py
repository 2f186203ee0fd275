"""What a result depends on besides its settings: the code, the libraries and the machine."""

import getpass
import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path


def user_name() -> str:
    """Name of whoever runs this process; "somebody" where the system knows none."""
    try:
        return getpass.getuser() or "somebody"
    except (ImportError, KeyError, OSError):  # as in a container with a user that is only a number
        return "somebody"


def cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def machine() -> str:
    """Processor, cores and system in one line."""
    return f"{_processor()}, {cores()} cores, {platform.system()} {platform.machine()}"


def versions() -> dict[str, str]:
    """Versions of what decides a run's bits."""
    names = ("sumo-dist", "mujoco", "numpy", "eclipse-zenoh")
    found = {name: importlib.metadata.version(name) for name in names}
    return {**found, "python": platform.python_version(), "machine": platform.machine()}


def release() -> str:
    """Version of the package, and the commit where it runs from a checkout."""
    return f"{importlib.metadata.version('sumo-dist')}{_commit()}"


def provenance() -> dict[str, str]:
    """What decides a result: the code and the machine."""
    return {
        "sumo_dist": release(),
        "mujoco": importlib.metadata.version("mujoco"),
        "python": platform.python_version(),
        "machine": machine(),
    }


def timing_provenance() -> dict[str, str]:
    """What a time must be read with: the code, the machine and its load now."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return {**provenance(), "load": load}


def _commit() -> str:
    """Name the commit where the package runs from a git checkout."""
    commit = _git("rev-parse", "--short", "HEAD")
    # Installed somewhere inside another project's checkout, it is no part of that commit.
    if commit is None or _git("ls-files", "--error-unmatch", "provenance.py") is None:
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
