"""`sumo-dist bench compare-methods` from outside: what it runs, and what it goes on from."""

import json

import pytest

from sumo_dist.cli import main

FILES = {"methods.md", "methods.json", "methods.svg"}


def compare(out, *more):
    small = ("--trials", "1", "--seed0", "1", "--time-limit", "0.1", "--jobs", "2")
    return main(["bench", "compare-methods", "--out", str(out), *small, *more])


@pytest.fixture(scope="module")
def joints_file(drawn_policy, tmp_path_factory):
    """Name the file of a policy that moves the joints, and has learnt nothing."""
    path = tmp_path_factory.mktemp("policy") / "joints.onnx"
    drawn_policy("spot/joints_move_box", seed=1, rate=50).save(path)
    return path


@pytest.mark.slow
def test_all_methods_are_compared_and_go_on_after_a_kill(
    tmp_path, policy_file, joints_file, capsys
):
    files = ("--hrl", str(policy_file), "--e2e-rl", str(joints_file))
    args = (*files, "--objects", "box")
    assert compare(tmp_path, *args) == 0
    first = capsys.readouterr()
    assert {path.name for path in tmp_path.iterdir()} == FILES | {
        f"{name}.jsonl" for name in ("sumo", "e2e-mpc", "e2e-rl", "hrl")
    }
    listed = json.loads((tmp_path / "methods.json").read_text())
    assert [(entry["method"], entry["task"]) for entry in listed] == [
        ("sumo", "spot/move_box"),
        ("sumo", "spot/upright_box"),
        ("e2e-mpc", "spot/joints_move_box"),
        ("e2e-rl", "spot/joints_move_box"),
        ("e2e-rl", "spot/joints_upright_box"),
        ("hrl", "spot/move_box"),
        ("hrl", "spot/upright_box"),
    ]
    rates = {
        name: json.loads((tmp_path / f"{name}.jsonl").read_text().splitlines()[0])["planner"]
        for name in ("sumo", "e2e-mpc", "e2e-rl", "hrl")
    }
    assert [planner["rate"] for planner in rates.values()] == [20, 50, 50, 20]
    assert [planner["rollouts"] for planner in rates.values()][2:] == [1, 1]

    (tmp_path / "hrl.jsonl").write_text("")  # as if it had been killed before its first end
    assert compare(tmp_path, *args) == 0
    again = capsys.readouterr()
    assert again.err.count(", hrl: ") == 2
    assert again.err.count(", sumo: ") == 0
    assert [line for line in again.out.splitlines() if "(1.00)" in line] == [
        line for line in first.out.splitlines() if "(1.00)" in line
    ]


def test_methods_without_a_policy_are_left_out_and_a_page_needs_no_run(tmp_path, capsys):
    assert compare(tmp_path, "--methods", "sumo", "--objects", "cone") == 0
    page = (tmp_path / "methods.md").read_text()
    assert "| move cone    | Sumo   | 0/1 " in page
    assert "RL" not in page.partition("## Trials")[2]
    capsys.readouterr()
    assert compare(tmp_path, "--report", "--objects", "cone") == 0
    said = capsys.readouterr()
    assert "| move cone    | Sumo   | 0/1 " in said.out
    assert " seed 1, " not in said.err


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("--methods", "sumo,mpc"), "unknown method 'mpc'; valid: e2e-mpc, e2e-rl, hrl, sumo"),
        (("--methods", "hrl"), "method hrl needs the file of its policy: --hrl FILE"),
        (("--methods", "e2e-rl"), "method e2e-rl needs the file of its policy: --e2e-rl FILE"),
        (("--objects", "box,ball"), "unknown object 'ball'; valid: box, chair, cone, rack, tire"),
        (("--hrl", "none.onnx"), "cannot read policy file none.onnx on this host"),
        (("--report",), "is done yet"),
        (("--trials", "0"), "trials must be at least 1"),
    ],
)
def test_bad_input_is_one_error(tmp_path, capsys, args, said):
    assert compare(tmp_path / "out", *args) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1


def test_a_policy_of_another_space_is_refused_before_anything_runs(tmp_path, capsys, policy_file):
    assert compare(tmp_path, "--e2e-rl", str(policy_file), "--methods", "e2e-rl") == 2
    assert "method e2e-rl: a learned policy whose" in capsys.readouterr().err
