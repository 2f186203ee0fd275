"""Wall clocks that jump, in a process of its own each."""

import json
import shutil
import subprocess
import sys
import time

import pytest

from sumo_dist.errors import UsageError
from sumo_dist.faults import clock
from sumo_dist.faults.clock import WallClock

needs_compiler = pytest.mark.skipif(
    sys.platform != "linux" or not any(map(shutil.which, clock.COMPILERS)),
    reason="needs Linux and a C compiler",
)
CHILD = """
import json, sys, threading, time
lock = threading.Lock(); lock.acquire()
for _ in sys.stdin:
    began = time.monotonic()
    lock.acquire(timeout=0.05)
    waited = time.monotonic() - began
    wall = time.time(), time.clock_gettime(time.CLOCK_REALTIME)
    print(json.dumps([*wall, time.monotonic(), waited]), flush=True)
"""


class Child:
    """Says what time it is."""

    def __init__(self, prefix):
        self._process = subprocess.Popen(
            [*prefix, sys.executable, "-c", CHILD],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ahead(self):
        """How far its clocks are ahead [s], and how long a wait of 0.05 s takes."""
        before = time.time(), time.time(), time.monotonic()
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        *said, waited = json.loads(self._process.stdout.readline())
        return [says - was for says, was in zip(said, before, strict=True)], waited

    def close(self):
        self._process.stdin.close()
        self._process.wait(10.0)


@needs_compiler
def test_the_wall_clock_of_a_process_jumps_and_back_and_its_monotonic_one_does_not():
    with WallClock() as wall:
        child = Child(wall.prefix)
        try:
            child.ahead()  # it has started
            for jump in (0.0, 3600.0, -3600.25, 0.0):
                wall.jump(jump)
                (said, got, steady), waited = child.ahead()
                assert (said, got) == pytest.approx((jump, jump), abs=1.0)
                assert 0 <= steady < 1.0
                assert 0.04 < waited < 1.0
        finally:
            child.close()


def test_without_a_compiler_there_is_one_clear_error(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(shutil, "which", lambda _name: None)
    with pytest.raises(UsageError, match="needs a C compiler: cc, gcc, clang"):
        WallClock()


def test_elsewhere_there_is_one_clear_error(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(UsageError, match="on Linux only"):
        WallClock()


@needs_compiler
def test_a_compiler_that_fails_is_told_with_its_reason(monkeypatch, tmp_path):
    broken = tmp_path / "broken.c"
    broken.write_text("no\n")
    monkeypatch.setattr(clock, "SOURCE", broken)
    with pytest.raises(UsageError, match=r"cannot compile broken\.c: "):
        WallClock()
