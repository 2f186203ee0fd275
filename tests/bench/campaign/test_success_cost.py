import json

import pytest

from sumo_dist.cli import main

SMALL = ("--time-limit", "0.1", "--jobs", "1", "--set", "horizon=0.1")
CELLS = ("--cell", "few: optimizer=ps,rollouts=2", "--cell", "more: rollouts=4")


def bench(out, *more, tasks="spot/move_box,g1/box_push"):
    return main(["bench", "success-cost", "--tasks", tasks, *SMALL, "--out", str(out), *more])


def rows(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_cells_take_turns_and_go_on_from_where_they_were(tmp_path, capsys):
    assert bench(tmp_path, "--trials", "2", *CELLS) == 0
    said = capsys.readouterr()
    turns = [line.split("] ")[1].split(":")[0] for line in said.err.splitlines() if "] " in line]
    assert turns == [
        f"{task} seed {seed}, {cell}"
        for seed in (1, 2)
        for task in ("spot/move_box", "g1/box_push")
        for cell in ("few", "more")
    ]
    few = rows(tmp_path / "few.jsonl")
    assert [(row["optimizer"], row["planner"]["rollouts"]) for row in few] == [("ps", 2)] * 4
    for row in few:
        assert row["plan_cpu_ms"] > 0
        assert row["plan_cpu_s"] * 1e3 == pytest.approx(row["plan_cpu_ms"] * row["plans"], abs=1)
    titles = [line for line in said.out.splitlines() if line.startswith("## ")]
    assert titles == ["## all tasks", "## spot", "## g1"]
    assert "- few: optimizer=ps, rollouts=2" in said.out

    (tmp_path / "more.jsonl").write_text("")  # as if it had been killed before its first end
    kept = (tmp_path / "few.jsonl").read_text()
    assert bench(tmp_path, "--trials", "2", "--by-task", *CELLS) == 0
    again = capsys.readouterr()
    assert "few.jsonl has 4 of 4 trials, 0 to go" in again.err
    assert again.err.count(", more: timeout") == 4
    assert (tmp_path / "few.jsonl").read_text() == kept
    assert "## spot/move_box" in again.out
    files = [str(tmp_path / name) for name in ("few.jsonl", "more.jsonl")]
    assert main(["bench", "compare", *files]) == 0
    assert "## Cost" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("--cell", "default,papr"), "unknown cell 'papr'; valid: "),
        (("--cell", "a: rolouts=3"), "cell a: unknown setting 'rolouts'; valid: base_noise"),
        (("--cell", "a: rollouts=many"), "cell a: setting rollouts needs a value of type int"),
        (("--cell", "a: rollouts=0"), "cell a: rollouts must be from 1 to"),
        (("--cell", "a: preset=papr"), "cell a: unknown preset 'papr'; valid: default, paper"),
        (("--cell", "a: optimizer=sgd"), "cell a: unknown optimizer 'sgd'; valid: cem"),
        (
            ("--tasks", "spot/upright_box", "--cell", "a: guidance=object"),
            "cell a: guidance=object is not for task 'spot/upright_box': it has no goal",
        ),
        ((), "cell reference: --set horizon=0.1 is for all cells, and reference has its own"),
        (("--tasks", "paper-analysys", *CELLS), "unknown task 'paper-analysys'; valid: "),
    ],
)
def test_bad_options_are_named_before_anything_runs(tmp_path, capsys, args, said):
    assert bench(tmp_path / "out", *args) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not any(path.stat().st_size for path in tmp_path.rglob("*.jsonl"))


def test_a_cell_that_changed_needs_another_name_or_folder(tmp_path, capsys):
    one = {"tasks": "spot/move_box"}
    assert bench(tmp_path, "--trials", "1", "--cell", "a: rollouts=2", **one) == 0
    assert bench(tmp_path, "--trials", "1", "--cell", "a: rollouts=3", **one) == 2
    assert "a.jsonl was made with other settings: rollouts is 2" in capsys.readouterr().err
