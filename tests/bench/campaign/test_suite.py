import json
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import tyro

from sumo_dist.bench.campaign import suite
from sumo_dist.cli import main

SMALL = ("--time-limit", "0.3", "--set", "rollouts=4", "--set", "horizon=0.1")
TWO = ("--tasks", "spot/move_box,spot/upright_cone", "--trials", "2", *SMALL)
TIMING = ("cpu_s", "plan_ms_p50", "plan_ms_p99", "plan_cpu_ms", "plan_cpu_s", "real_time_factor")


def arguments(out, *more):
    return ["bench", "suite", "paper-analysis", "--out", str(out), *more]


def rows(out):
    found = [json.loads(line) for line in (out / "trials.jsonl").read_text().splitlines()]
    return sorted(
        ({k: v for k, v in row.items() if k not in TIMING} for row in found),
        key=lambda row: (row["task"], row["seed"], row["variant"]),
    )


@pytest.mark.slow
def test_a_killed_suite_resumes_to_the_table_of_an_unbroken_one(tmp_path, capsys):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert main(arguments(whole, *TWO)) == 0
    table = capsys.readouterr().out

    command = [sys.executable, "-m", "sumo_dist", *arguments(broken, *TWO, "--jobs", "1")]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.PIPE) as process:
        journal, deadline = broken / "trials.jsonl", time.monotonic() + 60
        while not (journal.exists() and journal.read_text().count("\n") >= 2):
            assert time.monotonic() < deadline
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
    done = journal.read_text().splitlines()
    assert 2 <= len(done) < 6

    assert main(arguments(broken, *TWO)) == 0
    again = capsys.readouterr()
    assert again.out == table
    assert f"has {len(done)} of 6 trials" in again.err
    assert rows(broken) == rows(whole)
    assert journal.read_text().splitlines()[: len(done)] == done
    assert len(re.findall(r"^\| spot/", table, flags=re.MULTILINE)) == 2

    assert main(["bench", "report", str(broken)]) == 0
    for name in ("report.html", "report.md"):
        assert "0 of 4 trials succeeded" in (broken / name).read_text()
    assert main(["bench", "compare", str(whole), str(broken)]) == 0
    assert "All settings are the same." in capsys.readouterr().out


def test_recordings_are_made_afterwards_and_must_repeat(tmp_path, capsys):
    options = ("--tasks", "spot/move_box", "--trials", "1", *SMALL)
    assert main(arguments(tmp_path, *options, "--recordings", "none")) == 0
    recording = tmp_path / "recordings" / "spot_move_box-1" / "run.npz"
    assert not recording.exists()
    assert main(arguments(tmp_path, *options)) == 0
    assert recording.exists()

    recording.unlink()
    (row,) = rows(tmp_path)
    (tmp_path / "trials.jsonl").write_text(json.dumps({**row, "state_digest": "0" * 64}) + "\n")
    assert main(arguments(tmp_path, *options)) == 3
    assert "spot/move_box seed 1 did not repeat" in capsys.readouterr().err
    assert not recording.exists()


def test_the_command_of_a_report_asks_for_the_same():
    line = (
        "paper-analysis --out 'my results' --trials 3 --set rollouts=16 --set nodes=5 "
        "--optimizer mppi --time-limit 2.5 --recordings all --weight goal=80 --weight fall=9 "
        "--param goal=1,0"
    )
    options = tyro.cli(suite.Options, args=shlex.split(line))
    words = shlex.split(suite.command(options))
    assert words[:3] == ["sumo-dist", "bench", "suite"]
    assert tyro.cli(suite.Options, args=words[3:]) == options


def test_a_suite_knows_its_ten_tasks_and_controls():
    options = suite.Options(suite="paper-analysis", out=Path("x"))
    chosen, tasks = options.chosen()
    assert len(tasks) == 10
    # Paper, success over 20 trials.
    move = [chosen.figures[f"spot/move_{o}"].rate for o in ("box", "chair", "cone", "tire", "rack")]
    assert move == [0.85, 0.95, 1.0, 1.0, 1.0]
    upright = [chosen.figures[t].rate for t in tasks if "upright" in t]
    assert upright == [1.0, 0.95, 1.0, 0.95, 0.95]
    assert all("upright" in task for task in chosen.controls) and len(chosen.controls) == 5


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("paper-analysys",), "unknown suite 'paper-analysys'; valid: paper-analysis"),
        (("paper-analysis", "--tasks", "spot/juggle"), "unknown task of paper-analysis"),
        (("paper-analysis", "--trials", "0"), "trials must be at least 1"),
        (("paper-analysis", "--set", "rolouts=3"), "unknown setting 'rolouts'"),
        (("paper-analysis", "--weight", "goal=80"), "unknown cost term 'goal'; valid: fall, gri"),
    ],
)
def test_bad_options_are_named(tmp_path, capsys, args, said):
    assert main(["bench", "suite", *args, "--out", str(tmp_path)]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "suite.json").exists()


def test_a_folder_of_another_suite_is_refused(tmp_path, capsys):
    (tmp_path / "suite.json").write_text('{"suite": "paper-g1"}')
    assert main(arguments(tmp_path)) == 2
    assert "holds the suite paper-g1" in capsys.readouterr().err
