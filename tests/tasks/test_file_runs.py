"""A task from a file runs like any other: in one process, over Zenoh, and again from its folder."""

import json
import subprocess
import sys

import pytest

CRATE = """
from sumo_dist.tasks.spot.families import Manipuland, move

def task():
    return move(Manipuland("crate", "objects/box.xml", rest_z=0.254))
"""
SHORT = ("--seed", "3", "--time-limit", "0.4", "--viewer", "none", "--set", "rollouts=8")


def run(folder, *arguments):
    command = [sys.executable, "-m", "sumo_dist", "run", *arguments]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, timeout=150
    )


@pytest.mark.slow
def test_workers_load_the_file_and_plan_the_same(tmp_path):
    (tmp_path / "crate.py").write_text(CRATE)
    summaries = []
    for workers in ("0", "1"):
        out = tmp_path / workers
        done = run(
            tmp_path, "crate.py", *SHORT, "--workers", workers, "--out", str(out),
            "--listen", "tcp/127.0.0.1:0",
        )  # fmt: skip
        assert done.returncode == 1, done.stderr  # 0.4 s do not suffice
        summaries.append(json.loads((out / "summary.json").read_text()))
    assert [summary["task"] for summary in summaries] == ["spot/move_crate"] * 2
    for digest in ("plan_digest", "state_digest", "config_hash"):
        assert summaries[0][digest] == summaries[1][digest]


def test_a_bad_file_is_one_line_and_wrong_usage(tmp_path):
    (tmp_path / "crate.py").write_text("def task():\n    return nothing\n")
    done = run(tmp_path, "crate.py", *SHORT, "--workers", "0")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "crate.py, line 2: NameError: name 'nothing' is not defined" in done.stderr
