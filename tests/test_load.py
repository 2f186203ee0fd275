"""Cores that other programs use."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from sumo_dist import load
from sumo_dist.load import OtherLoad
from sumo_dist.provenance import cores

pytestmark = pytest.mark.skipif(not Path("/proc/stat").exists(), reason="needs Linux's /proc")

WORK = "import time\nend = time.process_time() + {}\nwhile time.process_time() < end: pass"


def test_it_is_a_number_of_cores(monkeypatch):
    others = OtherLoad()
    time.sleep(0.3)
    assert 0.0 <= others.used() <= cores() + 0.5


def test_what_this_process_and_its_children_do_is_not_of_others():
    """As they use it, what is left for others becomes less."""
    own = subprocess.Popen([sys.executable, "-c", WORK.format(60)])
    try:
        time.sleep(0.2)
        times = load._times()
        ours = times[1]
        assert own.pid in ours
        before = ours[own.pid]
        deadline = time.monotonic() + 60
        while load._times()[1][own.pid] < before + 0.3:
            assert time.monotonic() < deadline
            time.sleep(0.05)
    finally:
        own.kill()
        own.wait()
    assert own.pid not in load._times()[1]


def test_what_others_do_is_seen():
    """A process that has another parent than those of this run."""
    code = f"import os, sys\nif os.fork(): os._exit(0)\nos.setsid()\n{WORK.format(1.0)}"
    others, began = OtherLoad(), time.monotonic()
    subprocess.run([sys.executable, "-c", code], check=True)
    deadline, seen = began + 60, 0.0
    while seen < 0.5 and time.monotonic() < deadline:
        at = time.monotonic()
        time.sleep(0.5)
        seen += (others.used() or 0.0) * (time.monotonic() - at)
    assert seen >= 0.5  # core seconds
