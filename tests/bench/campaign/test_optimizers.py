import json

import pytest

from sumo_dist.bench.campaign import optimizers
from sumo_dist.bench.campaign.optimizers import Cell
from sumo_dist.cli import main

SMALL = ("--tasks", "spot/move_box", "--trials", "1", "--time-limit", "0.1", "--jobs", "2")
SHORT = ("--set", "horizon=0.1")


def bench(out, *more):
    return main(["bench", "optimizers", *SMALL, *SHORT, "--out", str(out), *more])


def rows(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_every_cell_has_a_journal_of_its_own_and_is_not_run_twice(tmp_path, capsys):
    cells = ("--optimizers", "icem,cem", "--budgets", "4,6")
    assert bench(tmp_path, *cells) == 0
    table = capsys.readouterr().out
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
    assert again.out == table
    assert again.err.count("has 1 of 1 trials, 0 to go") == 3
    assert (tmp_path / "cem-4.jsonl").read_text() == kept
    assert rows(tmp_path / "icem-6.jsonl")[0]["state_digest"] == icem["state_digest"]


def test_the_table_counts_each_cell_by_task_and_in_all(make_row):
    found = {
        Cell("cem", 16): [make_row("a", 1, 4.0), make_row("a", 2), make_row("b", 1, 6.0)],
        Cell("cma", 32): [make_row("a", 1, 5.0)],
    }
    lines = optimizers.table(found).splitlines()[2:]
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    wide, whole = ("0.09 to 0.91", "0.21 to 1.00")
    assert cells == [
        ["cem", "16", "a", "1/2", "0.50", wide, "4.00", "4.00", "success 1, timeout 1"],
        ["cem", "16", "b", "1/1", "1.00", whole, "6.00", "6.00", "success 1"],
        ["cem", "16", "all", "2/3", "0.67", "0.21 to 0.94", "5.00", "5.00", "success 2, timeout 1"],
        ["cma", "32", "a", "1/1", "1.00", whole, "5.00", "5.00", "success 1"],
    ]


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
