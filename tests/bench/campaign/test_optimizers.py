import json

import pytest

from sumo_dist.cli import main

SMALL = ("--tasks", "spot/move_box", "--trials", "1", "--time-limit", "0.1", "--jobs", "2")
SHORT = ("--set", "horizon=0.1")


def bench(out, *more):
    return main(["bench", "optimizers", *SMALL, *SHORT, "--out", str(out), *more])


def rows(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def counts(table):
    return [line.split("|")[1:7] for line in table.splitlines() if line.startswith("| ")]


def test_every_cell_has_a_journal_of_its_own_and_is_not_run_twice(tmp_path, capsys):
    cells = ("--optimizers", "icem,cem", "--budgets", "4,6")
    assert bench(tmp_path, *cells) == 0
    table = capsys.readouterr().out
    assert table.startswith("## spot/move_box")
    lines = [line[0].strip() for line in counts(table)[2:]]
    assert lines == ["icem-4", "cem-4", "icem-6", "cem-6"]
    names = ["cem-4.jsonl", "cem-6.jsonl", "icem-4.jsonl", "icem-6.jsonl"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names

    (icem,) = rows(tmp_path / "icem-6.jsonl")
    assert (icem["optimizer"], icem["planner"]["rollouts"]) == ("icem", 6)
    assert icem["planner"]["iterations"] == 2  # what makes it iCEM
    (cem,) = rows(tmp_path / "cem-6.jsonl")
    assert (cem["planner"]["iterations"], cem["planner"]["horizon"]) == (1, 0.1)

    (tmp_path / "icem-6.jsonl").unlink()  # as if it had been killed before the last cell
    kept = (tmp_path / "cem-4.jsonl").read_text()
    assert bench(tmp_path, *cells) == 0
    again = capsys.readouterr()
    assert counts(again.out) == counts(table)  # CPU time is not the same twice
    assert again.err.count("has 1 of 1 trials, 0 to go") == 3
    assert (tmp_path / "cem-4.jsonl").read_text() == kept
    assert rows(tmp_path / "icem-6.jsonl")[0]["state_digest"] == icem["state_digest"]


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("--optimizers", "cem,sgd"), "unknown optimizer 'sgd'; valid: cem, cma, icem, mppi, ps"),
        (("--budgets", "16,many"), "budgets must be whole numbers separated by commas"),
        (("--budgets", "0"), "rollouts must be from 1 to"),
        (("--budgets", "1", "--optimizers", "cma"), "2 iterations need at least as many rollouts"),
        (("--set", "rollouts=8"), "rollouts=8: say what to compare by --optimizers and --budgets"),
        (("--set", "optimizer=ps"), "optimizer=ps: say what to compare by"),
        (("--tasks", "spot/juggle"), "unknown task 'spot/juggle'"),
    ],
)
def test_bad_options_are_named_before_anything_runs(tmp_path, capsys, args, said):
    out = tmp_path / "out"
    assert bench(out, *args) == 2
    assert said in capsys.readouterr().err
    assert not any(path.stat().st_size for path in tmp_path.rglob("*.jsonl"))
