"""What is done to a process, on real ones."""

import os
import signal
import subprocess
import sys
import time

import pytest

from sumo_dist.faults.processes import children, fill_disk, free_disk, kill_children

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs Linux")
WRITER = """
import sys
import time
with open(sys.argv[1], "wb", buffering=0) as file:
    for _ in sys.stdin:
        try:
            file.write(b"x")
            print("written", flush=True)
        except OSError as error:
            print(error.strerror, flush=True)
"""


def test_a_full_disk_takes_nothing_and_a_free_one_does_again(tmp_path):
    command = [sys.executable, "-c", WRITER, str(tmp_path / "file")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as writer:

        def write():
            writer.stdin.write("\n")
            writer.stdin.flush()
            return writer.stdout.readline().strip()

        assert write() == "written"
        fill_disk(writer.pid)
        assert [write(), write()] == ["File too large"] * 2
        free_disk(writer.pid)
        assert write() == "written"
        writer.stdin.close()
    assert (tmp_path / "file").read_bytes() == b"xx"
    fill_disk(writer.pid)  # of one that has ended, nothing


def test_children_are_found_and_killed():
    with subprocess.Popen(["sh", "-c", "sleep 60; exit 3"]) as parent:
        deadline = time.monotonic() + 10.0
        while not children(parent.pid):
            assert time.monotonic() < deadline
        (child,) = children(parent.pid)
        assert children(child) == []
        kill_children(parent.pid)
        assert parent.wait(10.0) == 3
    with pytest.raises(ProcessLookupError):
        os.kill(child, signal.SIG_DFL)
