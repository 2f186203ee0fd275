"""Sizes of real processes."""

import subprocess
import sys

import pytest

from sumo_dist.faults import growth
from sumo_dist.faults.growth import GrowthMonitor

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")


def test_a_process_is_sampled_while_it_lives(monkeypatch):
    monkeypatch.setattr(growth, "PERIOD_S", 0.0)
    monkeypatch.setattr(growth, "WARM_UP_S", 0.0)
    monitor = GrowthMonitor()
    with subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        process.stdin.write(b"x\n")
        process.stdin.flush()
        process.stdout.readline()  # it is loaded
        for _ in range(3):
            monitor.sample({"cat": process})
        process.kill()
    monitor.sample({"cat": process})
    (found,) = monitor.growths()
    assert (found.service, found.lives) == ("cat", 1)
    assert 0.0 < found.mb[1] < 100.0 and found.files[1] >= 1
    assert len(monitor.csv().splitlines()) == 1 + 3


def test_a_process_that_still_loads_does_not_count():
    monitor = GrowthMonitor()
    with subprocess.Popen(["sleep", "60"]) as process:
        monitor.sample({"sleeper": process})
        process.kill()
    assert monitor.growths() == []
