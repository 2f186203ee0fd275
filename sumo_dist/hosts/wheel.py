"""A wheel of this checkout, for hosts that have another version or none."""

import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import sumo_dist
from sumo_dist.errors import SumoError

_TOOLS = ("scikit_build_core", "nanobind")
_TIMEOUT_S = 900


@contextmanager
def built_wheel(root: Path | None = None) -> Iterator[Path]:
    """Build a wheel, which is there while this is entered.

    Args:
        root: of a checkout; None takes the one that this package runs from.

    Raises:
        SumoError: this package does not run from a checkout, or the build failed.
    """
    root = root or Path(sumo_dist.__file__).parents[1]
    if not (root / "pyproject.toml").is_file():
        raise SumoError(
            "sumo-dist runs from no checkout here, so there is nothing to build what hosts need: "
            "launch from one, or install the same version on the hosts"
        )
    here = all(importlib.util.find_spec(name) for name in _TOOLS)
    with tempfile.TemporaryDirectory(prefix="sumo-dist-") as scratch:
        command = [
            *(sys.executable, "-P", "-m", "pip", "wheel", "--no-deps", "--no-input", "--quiet"),
            *("--disable-pip-version-check", "--wheel-dir", scratch),
            *(("--no-build-isolation",) if here else ()),
            str(root),
        ]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False,
            # cmake and ninja of this environment, where it has them
            env={**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"},
        )  # fmt: skip
        wheels = list(Path(scratch).glob("*.whl"))
        if done.returncode != 0 or not wheels:
            last = (done.stderr.strip().splitlines() or ["no wheel came of it"])[-1]
            raise SumoError(f"cannot build a wheel of {root}: {last}")
        yield wheels[0]
