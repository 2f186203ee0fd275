from sumo_dist.bench.results import success_cost


def lines(out, title):
    """Cells of each line of the table below a title, without its head."""
    _, _, below = out.partition(f"## {title}\n\n")
    table, _, _ = below.partition("\n\n")
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()[2:]]


def test_a_line_says_what_was_solved_how_fast_at_what_cost_and_how_it_moved(make_row):
    moved = {"limb_reversals_hz": 3.0, "target_jerk": 1200.0, "work_j": 5.0}
    few = [
        make_row("a", 1, 4.0, plan_cpu_ms=20.0, plan_cpu_s=8.0, motion=moved),
        make_row("a", 2, plan_cpu_ms=30.0, plan_cpu_s=12.0, motion=moved),
    ]
    old = [make_row("a", 1, 5.0)]  # of before anything of it was measured
    out = success_cost.text({"few": few, "old": old}, {"few": "rollouts=2", "old": "x=1"}, False)
    measured, unknown = lines(out, "a")
    counts = ["1/2", "0.50", "0.09 to 0.91", "4.00", "4.00"]
    # Two drawn of two: only the solved one (8 s each), both (20 s for one), or nobody solves.
    cost = ["25.0", "20.00", "8.00 to inf"]
    assert measured == ["few", *counts, *cost, "3.0", "1200", "-", "-", "success 1, timeout 1"]
    assert unknown[0] == "old"
    assert unknown[6:] == [*["-"] * 7, "success 1"]
    assert "## all tasks" not in out  # it is one
    assert "- few: rollouts=2\n- old: x=1" in out
    assert "sumo-dist 0.1.0 (commit abc), MuJoCo 4.0.0, a computer & its cores." in out


def test_tasks_are_counted_together_by_robot_and_each_if_asked_for(make_row):
    found = {
        "x": [make_row("a", 1, 4.0), make_row("a", 2), make_row("b", 1, 6.0, robot="g1")],
        "y": [make_row("b", 1, robot="g1")],
    }
    settings = dict.fromkeys(found, "")
    out = success_cost.text(found, settings, by_task=True)
    counted = {
        title: [line[:2] for line in lines(out, title)]
        for title in ("all tasks", "spot", "g1", "a", "b")
    }
    assert counted == {
        "all tasks": [["x", "2/3"], ["y", "0/1"]],
        "spot": [["x", "1/2"]],
        "g1": [["x", "1/1"], ["y", "0/1"]],
        "a": [["x", "1/2"]],
        "b": [["x", "1/1"], ["y", "0/1"]],
    }
    out = success_cost.text(found, settings, by_task=False)
    assert "## spot\n" in out
    assert "## a\n" not in out
