import json

import pytest

from sumo_dist.cli import main

BOX, CONE = "spot/move_box", "spot/move_cone"


@pytest.fixture
def campaign(tmp_path, make_row):
    """Return a function that writes a campaign: campaign(name, {task: times}, **settings)."""

    def write(name, tasks, **more):
        rows = [
            make_row(task, seed, time, **more)
            for task, times in tasks.items()
            for seed, time in enumerate(times, 1)
        ]
        path = tmp_path / name
        path.write_text("".join(json.dumps(row) + "\n" for row in rows))
        return str(path)

    return write


def cells(out, task):
    (line,) = [line for line in out.splitlines() if line.startswith(f"| {task} ")]
    return [cell.strip() for cell in line.split("|")[1:-1]]


def test_a_campaign_against_itself(campaign, capsys):
    a = campaign("a.jsonl", {BOX: [4.0, 5.0, None, 6.0]})
    assert main(["bench", "compare", a, a]) == 0
    out = capsys.readouterr().out
    expected = [BOX, "3/4", "3/4", "+0.00", "-0.49 to +0.49", "1.000", "3", "1.00"]
    assert cells(out, BOX)[:8] == expected
    assert "3/4 -> 3/4 solved, no change; it takes 1.00 times as long over 3 seeds, as fast." in out
    assert "All settings are the same." in out


def test_what_is_significant_is_said_and_what_is_not_too(campaign, capsys):
    a = campaign("a.jsonl", {BOX: [None] * 10 + [8.0] * 2, CONE: [4.0, 5.0, 6.0, 7.0] * 3})
    b = campaign("b.jsonl", {BOX: [7.0] * 12, CONE: [3.0, 4.0, 5.0, 6.0] * 3})
    assert main(["bench", "compare", a, b]) == 0
    out = capsys.readouterr().out
    assert f"{BOX}: 2/12 -> 12/12 solved, more (significant, p < 0.001)" in out
    assert "0.88 times as long over 2 seeds, faster (not significant, p = 0.500)" in out
    # Wilcoxon, 12 pairs all of one sign: 2 / 2^12, twice for two tasks.
    assert f"{CONE}: 12/12 -> 12/12 solved, no change; it takes 0.81" in out
    assert "faster (significant, p < 0.001)" in out
    assert cells(out, "all tasks")[1:3] == ["14/24", "24/24"]


def test_settings_that_differ_are_named(campaign, make_row, capsys):
    row = make_row(BOX, 1)
    a = campaign("a.jsonl", {BOX: [4.0]})
    planner = {**row["planner"], "rollouts": 48}
    b = campaign("b.jsonl", {BOX: [None]}, planner=planner, config_hash="x", time_limit_s=20.0)
    assert main(["bench", "compare", a, b]) == 0
    out = capsys.readouterr().out
    assert "no seed that both solved" in out
    assert f"- rollouts: {row['planner']['rollouts']} -> 48" in out
    assert f"- {BOX}, time limit [s]: 30.0 -> 20.0" in out
    assert f"- {BOX}, task and settings: hash of {BOX} -> x" in out
    assert out.count("->") == 4  # three settings, one verdict


def test_another_plant_is_a_setting(campaign, capsys):
    a = campaign("a.jsonl", {BOX: [4.0]})  # rows of old journals do not say
    b = campaign("b.jsonl", {BOX: [5.0]}, plant="hard", estimator="truth")
    assert main(["bench", "compare", a, b]) == 0
    out = capsys.readouterr().out
    assert "- plant: nominal -> hard" in out
    assert "estimator" not in out


def test_other_weights_and_parameters_are_settings(campaign, capsys):
    a = campaign("a.jsonl", {BOX: [4.0]})  # rows of old journals do not say
    b = campaign("b.jsonl", {BOX: [5.0]}, weight=["goal=80"], param=[])
    assert main(["bench", "compare", a, b]) == 0
    out = capsys.readouterr().out
    assert "- weight: [] -> ['goal=80']" in out
    assert "- param" not in out


def test_tasks_that_only_one_has_are_named_and_left_out(campaign, capsys):
    a = campaign("a.jsonl", {BOX: [4.0, 5.0], CONE: [1.0]})
    b = campaign("b.jsonl", {BOX: [4.0, None]})
    assert main(["bench", "compare", a, b]) == 0
    out = capsys.readouterr().out
    assert f"- only one of the two has {CONE}" in out
    assert f"{CONE}:" not in out
    assert "all tasks" not in out


def test_controls_are_left_out(campaign, capsys):
    a = campaign("a.jsonl", {BOX: [4.0]})
    b = campaign("b.jsonl", {BOX: [4.0]}, variant="standing")
    assert main(["bench", "compare", a, b]) == 2
    assert "no task in common: spot/move_box in A, no trials in B" in capsys.readouterr().err


def test_what_is_no_campaign_is_one_error(campaign, tmp_path, capsys):
    a = campaign("a.jsonl", {BOX: [4.0]})
    assert main(["bench", "compare", a, str(tmp_path)]) == 2
    assert "cannot read the trials in" in capsys.readouterr().err


def test_motion_stands_beside_and_as_a_ratio(campaign, capsys):
    a = campaign("a.jsonl", {BOX: [4.0, 4.0]}, motion={"work_j": 200.0, "joint_jerk": 0.0})
    b = campaign("b.jsonl", {BOX: [4.0, None]}, motion={"work_j": 100.0})
    assert main(["bench", "compare", a, b]) == 0
    lines = capsys.readouterr().out.splitlines()
    of = {line.split("|")[1].strip(): line.split("|")[-2].strip() for line in lines if "|" in line}
    assert (of[f"{BOX}, A"], of[f"{BOX}, B"], of["B / A"]) == ("200", "100", "0.50")


def test_there_is_no_motion_to_compare_if_only_one_was_measured(campaign, capsys):
    a = campaign("a.jsonl", {BOX: [4.0]}, motion={"work_j": 200.0})
    assert main(["bench", "compare", a, campaign("b.jsonl", {BOX: [4.0]})]) == 0
    assert "Motion" not in capsys.readouterr().out


def test_cost_stands_beside_and_as_a_ratio(campaign, capsys):
    a = campaign("a.jsonl", {BOX: [4.0, 4.0]}, plan_cpu_ms=40.0, plan_cpu_s=6.0)
    b = campaign("b.jsonl", {BOX: [4.0, None]}, plan_cpu_ms=10.0, plan_cpu_s=1.5)
    assert main(["bench", "compare", a, b]) == 0
    out = capsys.readouterr().out
    assert cells(out, f"{BOX}, A")[1:3] == ["40.0", "6.00"]
    assert cells(out, f"{BOX}, B")[1:3] == ["10.0", "3.00"]
    assert cells(out, "B / A") == ["B / A", "0.25", "0.50", "-"]


def test_there_is_no_cost_to_compare_if_only_one_was_measured(campaign, capsys):
    a = campaign("a.jsonl", {BOX: [4.0]}, plan_cpu_ms=40.0, plan_cpu_s=6.0)
    assert main(["bench", "compare", a, campaign("b.jsonl", {BOX: [4.0]})]) == 0
    assert "Cost" not in capsys.readouterr().out
    none = campaign("c.jsonl", {BOX: [None]}, plan_cpu_ms=40.0, plan_cpu_s=6.0)
    assert main(["bench", "compare", a, none]) == 0
    assert cells(capsys.readouterr().out, "B / A") == ["B / A", "1.00", "-", "-"]
