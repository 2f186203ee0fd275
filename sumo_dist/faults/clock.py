"""A wall clock that jumps, for chosen processes only: the machine's own stays as it is.

The processes load a few lines of C (clock.c) that shift what the C library says the time is, by an
offset in a file that all of them map. What already waits for a time of day does not notice a jump.
"""

import mmap
import shutil
import struct
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from sumo_dist.errors import UsageError

SOURCE = Path(__file__).with_name("clock.c")
COMPILERS = ("cc", "gcc", "clang")
VARIABLE = "SUMO_DIST_CLOCK"  # names the file with the offset; clock.c knows it as well

_OFFSET = struct.Struct("=q")  # [ns]
_COMPILE_S = 60.0


class WallClock:
    """The wall clock of some processes. A context manager.

    Attributes:
        prefix: command before that of a process whose clock it is to be.
    """

    def __init__(self) -> None:
        """Compile and map.

        Raises:
            UsageError: this is not Linux, or there is no C compiler that works.
        """
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="sumo-clock-")))
            library, offset = folder / "clock.so", folder / "offset"
            _compile(library)
            offset.write_bytes(_OFFSET.pack(0))
            with offset.open("r+b") as file:
                self._page = stack.enter_context(mmap.mmap(file.fileno(), _OFFSET.size))
            self.prefix = ("env", f"LD_PRELOAD={library}", f"{VARIABLE}={offset}")
            self._stack = stack.pop_all()

    def jump(self, seconds: float) -> None:
        """Let the clocks go that far ahead of the machine's, or behind it, from now on [s]."""
        _OFFSET.pack_into(self._page, 0, round(seconds * 1e9))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def _compile(library: Path) -> None:
    if sys.platform != "linux":
        raise UsageError("the wall clock of a service can be moved on Linux only")
    compiler = next((found for name in COMPILERS if (found := shutil.which(name))), None)
    if compiler is None:
        raise UsageError(f"moving a wall clock needs a C compiler: {', '.join(COMPILERS)}")
    command = [compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(SOURCE), "-ldl"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_COMPILE_S)
    if done.returncode:
        said = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise UsageError(f"{compiler} cannot compile {SOURCE.name}: {said[-1]}")
