"""`sumo-dist tune`: what it leaves, how it goes on, and what it refuses."""

import json
import shutil
import signal
import subprocess
import sys
import threading
import time
import tomllib
import xml.etree.ElementTree as ElementTree

import pytest

from sumo_dist.bench.tune.folder import read_trials
from sumo_dist.bench.tune.results import best
from sumo_dist.cli import main
from sumo_dist.launch.launcher import listening

SEARCH = ("--weight", "ahead=0.1:10", "--seeds", "1-2", "--first", "1", "--held-out", "3-4")
TIMING = ("cpu_s", "plan_ms_p50", "plan_ms_p99", "plan_cpu_ms", "plan_cpu_s", "real_time_factor")


def arguments(walk, out, *more):
    usual = ("--start", "random", "--trials", "4", "--jobs", "1")
    return ["tune", str(walk), *SEARCH, *usual, "--out", str(out), *more]


def rows(folder):
    lines = (folder / "episodes.jsonl").read_text().splitlines()
    varying = {*TIMING, "provenance"}  # a checkout may change while its tests run
    return [{k: v for k, v in json.loads(x).items() if k not in varying} for x in lines]


@pytest.fixture(scope="module")
def searched(walk, tmp_path_factory):
    """The folder of a whole search."""
    out = tmp_path_factory.mktemp("searched") / "a"
    assert main(arguments(walk, out)) == 0
    return out


def test_a_search_leaves_a_journal_a_report_a_picture_and_the_winner(searched):
    trials = read_trials(searched)
    winner = best(trials)
    assert [trial.number for trial in trials] == [0, 1, 2, 3]
    assert {trial.solved for trial in trials} == {0, 2}  # the weight decides
    assert winner is not None and winner.solved == 2
    report = (searched / "report.md").read_text()
    assert f"The winner is trial {winner.number}, loss {winner.loss:.3f}, 2 of 2 seeds" in report
    assert f"| trial-{winner.number} " in report  # on held-out seeds
    assert "| own " in report and "Seeds 3, 4, one after the other" in report
    assert report.count("| complete |") == 4
    assert "![success against CPU hours](curve.svg)" in report
    ElementTree.parse(searched / "curve.svg")
    file = tomllib.loads((searched / "winner.toml").read_text())
    assert file["weights"] == {"ahead": winner.values["weight ahead"], "stand": 1.0}
    assert file["parameters"] == {"far": 0.05, "slope": 1.0}
    assert (file["task"], file["planner"]["rollouts"]) == ("spot/walk", 6)
    assert file["origin"]["trial"] == winner.number
    assert file["origin"]["command"].startswith("sumo-dist tune ")


def test_a_killed_search_goes_on_to_the_same_end(searched, walk, tmp_path, capsys):
    out = shutil.copytree(searched, tmp_path / "b")
    journal = out / "episodes.jsonl"
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join(lines[:3]) + lines[3][:60])
    (out / "report.md").unlink()
    assert main(arguments(walk, out, "--held-out", "none")) == 0
    said = capsys.readouterr().err
    assert "has trials: 1 running, 1 complete; it goes on" in said
    assert "dropped a last line that was not written to its end" in said
    assert rows(out) == rows(searched)
    assert "--settings" in said and (out / "report.md").exists()
    assert main(arguments(walk, out)) == 0, capsys.readouterr().err  # nothing is left to do
    assert rows(out) == rows(searched)


def test_a_winner_can_be_run_and_benched(searched, walk, tmp_path, capsys):
    winner = ("--settings", str(searched / "winner.toml"))
    run = ("run", str(walk), "--seed", "1", "--workers", "0", "--threads", "1", "--viewer", "none")
    assert main([*run, *winner, "--out", str(tmp_path / "run")]) == 0
    against = ("--weight", "ahead=0.1", "--out", str(tmp_path / "other"))
    assert main([*run, *winner, *against]) == 1  # the command line wins
    bench = ("bench", "episodes", "--tasks", str(walk), "--trials", "1", "--jobs", "1")
    assert main([*bench, *winner, "--out", str(tmp_path / "a.jsonl")]) == 0
    assert "| 1/1 " in capsys.readouterr().out
    (row,) = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    of_search = next(r for r in rows(searched) if r["success"] and r["seed"] == 1)
    assert row["state_digest"] == of_search["state_digest"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--seed", "7"), "holds another search: seed is 0 there and 7 here; name another folder"),
        (("--weights", "stand"), "searched weight stand is None there and {'low': 0.1, 'high'"),
        (("--seeds", "1-2,5"), "seeds is [1, 2] there and [1, 2, 5] here"),
        (("--set", "rollouts=5"), "planner rollouts is 6 there and 5 here"),
        (("--plant", "hard"), "plant is nominal there and hard here"),
        (("--start", "own"), "start is random there and own here"),
    ],
)
def test_another_search_is_refused_with_what_differs(searched, walk, capsys, more, said):
    before = (searched / "episodes.jsonl").read_text()
    assert main(arguments(walk, searched, *more)) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert (searched / "episodes.jsonl").read_text() == before


def test_a_folder_of_something_else_is_refused(walk, tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("years")
    assert main(arguments(walk, tmp_path)) == 2
    assert "holds something else than a search; name another folder" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--trials", "0"), "trials must be at least 1, got 0"),
        (("--seeds", "1-"), "seeds must be different seeds such as 1-4 or 1,3,9, got '1-'"),
        (("--seeds", "4-1"), "seeds must be different seeds"),
        (("--seeds", "1,1"), "seeds must be different seeds"),
        (("--seeds", "-3"), "seeds must be different seeds"),
        (("--held-out", "many"), "held-out must be different seeds"),
        (("--held-out", "2-5"), "seeds 2 are both searched with and held out"),
        (("--first", "3"), "first must be from 1 to 2, as there are so many seeds, got 3"),
        (("--first", "0"), "first must be from 1 to 2"),
        (("--seed", "-1"), "seed must be at least 0, got -1"),
        (("--jobs", "0"), "jobs must be at least 1"),
        (("--weights", "gaol"), "unknown cost term 'gaol'; valid: ahead, stand"),
        (("--param", "far=0.01:1"), "parameter far decides where spot/walk starts or when it is"),
        (("--param", "slope=1:10"), "parameter 'slope' must be from 0 to 9, got"),
        (("--settings", "no.toml"), "no settings file at no.toml: No such file or directory"),
        (("--out", "/dev/null/a"), "cannot write to /dev/null/a: Not a directory"),
    ],
)
def test_what_cannot_be_is_one_line_and_leaves_nothing(walk, tmp_path, capsys, more, said):
    assert main(arguments(walk, tmp_path / "a", *more)) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not (tmp_path / "a").exists()


def test_two_searches_are_put_on_one_page(searched, walk, tmp_path, capsys):
    other = tmp_path / "other"
    short = ("--seed", "1", "--trials", "1", "--held-out", "none")
    assert main(arguments(walk, other, *short)) == 0
    page = tmp_path / "page.md"
    assert main(["bench", "tune-report", str(searched), str(other), "--out", str(page)]) == 0
    text = page.read_text()
    assert "| a      | 0    | 4 " in text and "| other  | 1    | 1 " in text
    assert "## a" in text and "## other" in text and "(page.svg)" in text
    ElementTree.parse(tmp_path / "page.svg")
    assert main(["bench", "tune-report", str(tmp_path), "--out", str(page)]) == 2
    assert "holds no search of `sumo-dist tune`" in capsys.readouterr().err
    assert main(["bench", "tune-report", str(other), "--out", str(tmp_path / "page.html")]) == 2
    assert "out must be a file NAME.md" in capsys.readouterr().err


@pytest.mark.slow
def test_an_interrupted_search_says_how_to_go_on(walk, tmp_path):
    out = tmp_path / "a"
    call = [sys.executable, "-P", "-m", "sumo_dist", *arguments(walk, out, "--trials", "500")]
    with subprocess.Popen(call, stderr=subprocess.PIPE, text=True) as process:
        journal, deadline = out / "episodes.jsonl", time.monotonic() + 120
        while not (journal.exists() and journal.read_text().count("\n") >= 2):
            assert time.monotonic() < deadline and process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert f"interrupted; all that has ended is in {out}, and the same command goes on" in said
    assert "Traceback" not in said
    found = read_trials(out)
    assert sum(len(trial.rows) for trial in found) == journal.read_text().count("\n")
    assert "500 trials are complete" in (out / "report.md").read_text()


@pytest.mark.slow
def test_a_trial_worker_tries_the_same(searched, walk, tmp_path):
    endpoint, out, codes = listening("tcp/127.0.0.1:0"), tmp_path / "a", []
    call = arguments(walk, out, "--listen", endpoint, "--jobs", "0")
    thread = threading.Thread(target=lambda: codes.append(main(call)), daemon=True)
    worker = [sys.executable, "-P", "-m", "sumo_dist", "trial-worker", "--connect", endpoint]
    thread.start()
    with subprocess.Popen([*worker, "--jobs", "1"]) as process:
        try:
            thread.join(150)
        finally:
            process.terminate()
    assert codes == [0]
    assert rows(out) == rows(searched)
    assert "one after the other of both" in (out / "report.md").read_text()
