import json

import pytest

from sumo_dist.bench.campaign import episodes
from sumo_dist.cli import main

TIMING = ("cpu_s", "plan_ms_p50", "plan_ms_p99", "plan_cpu_ms", "plan_cpu_s", "real_time_factor")


def campaign(out, *more):
    small = ("--time-limit", "0.2", "--set", "rollouts=4", "--set", "horizon=0.1")
    tasks = ("--tasks", "spot/move_box", "--seed0", "1", "--jobs", "2", "--out", str(out))
    return main(["bench", "episodes", *tasks, *small, *more])


def rows(path):
    found = [json.loads(line) for line in path.read_text().splitlines()]
    return sorted(
        ({k: v for k, v in row.items() if k not in TIMING} for row in found),
        key=lambda row: row["seed"],
    )


def test_a_killed_campaign_goes_on_to_the_same_table(tmp_path, capsys):
    whole, broken = tmp_path / "whole.jsonl", tmp_path / "broken.jsonl"
    assert campaign(whole, "--trials", "2") == 0
    table = capsys.readouterr().out
    first = whole.read_text().splitlines(keepends=True)[0]
    broken.write_text(first + first[:50])
    assert campaign(broken, "--trials", "2") == 0
    again = capsys.readouterr()
    assert again.out == table
    assert "has 1 of 2 trials, 1 to go" in again.err
    assert rows(broken) == rows(whole)
    assert broken.read_text().startswith(first)


def test_a_row_says_what_and_how(tmp_path, capsys):
    out, recordings = tmp_path / "a.jsonl", tmp_path / "recordings"
    assert campaign(out, "--trials", "1", "--recordings", str(recordings)) == 0
    (row,) = rows(out)
    assert (row["task"], row["seed"], row["end_reason"]) == ("spot/move_box", 1, "timeout")
    assert row["success"] is False
    assert row["completion_time_s"] is None
    assert set(row["final_costs"]) == {"goal", "gripper", "velocity", "fall"}
    # The box does not move in 0.2 s: the goal's term is 60 per metre.
    assert row["final_costs"]["goal"] == pytest.approx(60 * row["final_goal_distance_m"], rel=1e-3)
    assert (recordings / "spot_move_box-1" / "run.npz").exists()
    assert "| spot/move_box | 0/1 " in capsys.readouterr().out


def test_weights_and_parameters_reach_a_trial(tmp_path):
    usual, other = tmp_path / "usual.jsonl", tmp_path / "other.jsonl"
    weights = ("--weight", "goal=80", "--weight", "gripper=0")
    assert campaign(usual, "--trials", "1") == 0
    assert campaign(other, "--trials", "1", *weights, "--param", "goal=1,0") == 0
    (before,), (after,) = rows(usual), rows(other)
    assert (before["weight"], before["param"]) == ([], [])
    assert (after["weight"], after["param"]) == (["goal=80", "gripper=0"], ["goal=1,0"])
    assert before["final_costs"]["gripper"] > 0
    assert after["final_costs"]["gripper"] == 0
    distance = after["final_goal_distance_m"]
    assert abs(distance - before["final_goal_distance_m"]) > 0.1
    assert after["final_costs"]["goal"] == pytest.approx(80 * distance, rel=1e-3)
    assert after["config_hash"] == before["config_hash"]  # a plan's question says the rest
    assert campaign(other, "--trials", "1", *weights, "--param", "goal=1,0") == 0  # it goes on
    assert campaign(other, "--trials", "1", *weights) == 2


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("--set", "rollouts=5"), "rollouts is 4 there and 5 here"),
        (("--time-limit", "0.3"), "time_limit_s is 0.2 there and 0.3 here"),
        (("--weight", "goal=80"), "weight is [] there and ['goal=80'] here"),
        (("--param", "goal=1,0"), "param is [] there and ['goal=1,0'] here"),
    ],
)
def test_a_file_of_other_settings_is_refused(tmp_path, capsys, args, said):
    out = tmp_path / "a.jsonl"
    assert campaign(out, "--trials", "1") == 0
    assert campaign(out, *args) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("--tasks", "spot/juggle"), "unknown task 'spot/juggle'; valid:"),
        (("--trials", "0"), "trials must be at least 1"),
        (("--jobs", "0"), "jobs must be at least 1"),
        (("--engine", "diesel"), "unknown engine 'diesel'; valid: auto"),
        (("--weight", "gaol=80"), "unknown cost term 'gaol'; valid: fall, goal,"),
        (("--param", "goal=1"), "parameter 'goal' needs 2 finite numbers"),
    ],
)
def test_bad_options_are_named(tmp_path, capsys, args, said):
    assert campaign(tmp_path / "a.jsonl", *args) == 2
    assert said in capsys.readouterr().err


def test_the_table_counts_tasks_apart():
    def row(task, success, time):
        reason = "success" if success else "fell"
        return {
            "task": task,
            "variant": "planned",
            "success": success,
            "completion_time_s": time,
            "end_reason": reason,
        }

    lines = episodes.table(
        [row("a", True, 4.0), row("a", True, 7.0), row("b", True, 2.0), row("a", False, None)]
    ).splitlines()
    a, b = ([cell.strip() for cell in line.split("|")[1:-1]] for line in lines[2:])
    assert a == ["a", "2/3", "0.67", "0.21 to 0.94", "5.50", "5.50", "success 2, fell 1"]
    assert b == ["b", "1/1", "1.00", "0.21 to 1.00", "2.00", "2.00", "success 1"]


def test_trials_by_a_learned_policy_are_told_from_those_of_another(tmp_path, drawn_policy, capsys):
    out, path = tmp_path / "trials.jsonl", tmp_path / "policy.onnx"
    drawn_policy("spot/move_box", seed=1).save(path)
    args = ("--tasks", "spot/move_box,spot/upright_cone", "--trials", "1", "--time-limit", "0.2")
    command = ["bench", "episodes", *args, "--out", str(out), "--policy-file", str(path)]
    assert main(command) == 0
    assert [row["planner"]["policy"] for row in rows(out)] == [str(path)] * 2
    drawn_policy("spot/move_box", seed=2).save(path)
    capsys.readouterr()
    assert main(command) == 2
    assert "was made with other settings: policy_sha256 is" in capsys.readouterr().err
