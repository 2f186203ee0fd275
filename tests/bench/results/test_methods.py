"""The page of methods says what is in the journals, beside what the paper has."""

import xml.etree.ElementTree as ET

import pytest

from sumo_dist.bench.results.bars import picture
from sumo_dist.bench.results.methods import METHODS, OBJECTS, Outcome, listing, text
from sumo_dist.tasks import task_names

ORIGIN = {
    "trained": {"task": "spot/move_box", "seed": 3},
    "updates": 400,
    "actions": 6_553_600,
    "robot_hours": 91.02,
    "wall_s": 5400,
    "cpu_s": 9000,
    "sumo_dist": "0.1.0 (commit def)",
    "machine": "another computer",
}


@pytest.fixture
def outcomes(make_row):
    """Of the planner on three tasks, end-to-end MPC on one, and a policy on one."""

    def rows(method, family, thing, *times):
        task = METHODS[method].task(family, thing)
        return [make_row(task, seed, time, cpu_s=2.5) for seed, time in enumerate(times, 1)]

    sumo = [
        *rows("sumo", "move", "box", 4.0, 6.0, None),
        *rows("sumo", "move", "rack", 5.0, 5.0, 5.0),
        *rows("sumo", "upright", "tire", 1.0, 2.0, 3.0),
    ]
    mpc = rows("e2e-mpc", "move", "box", None, None)
    hrl = rows("hrl", "move", "box", 8.0)
    found = {"sumo": (sumo, {}), "e2e-mpc": (mpc, {}), "hrl": (hrl, ORIGIN)}
    return [Outcome.of(METHODS[name], *of_it) for name, of_it in found.items()]


def cells(page, *begin):
    """Return the cells of the only line of a table that begins with some."""
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines()]
    (found,) = [line for line in lines if tuple(line[: len(begin)]) == begin]
    return found[len(begin) :]


def test_every_rate_stands_beside_the_papers(outcomes):
    page = text(outcomes, "sumo-dist bench compare-methods", "methods.svg")
    both = ["-", "0.67 (0.85)", "- (0.95)", "- (1.00)", "- (1.00)", "1.00 (1.00)"]
    assert both[1:] in [
        [cell.strip() for cell in line.split("|")[2:-1]] for line in page.splitlines()
    ]
    assert cells(page, "move box", "Sumo") == [
        *("2/3", "0.67", "0.21 to 0.94", "0.85", "5.00", "2.5", "success 2, timeout 1")
    ]
    assert cells(page, "move box", "end-to-end MPC")[:4] == ["0/2", "0.00", "0.00 to 0.66", "0.00"]
    assert cells(page, "upright tire", "Sumo")[3] == "0.95"
    assert "end-to-end RL" not in page
    assert "![success of each method](methods.svg)" in page


def test_what_a_training_took_stands_on_the_page(outcomes):
    page = text(outcomes, "sumo-dist bench compare-methods", "methods.svg")
    assert cells(page, "hierarchical RL", "spot/move_box") == [
        *("3", "400", "6553600", "91.02", "1.50", "2.50", "0.1.0 (commit def)", "another computer")
    ]


def test_rates_of_policies_trained_on_each_object_have_a_line(make_row):
    row = make_row("spot/joints_move_box", 1, 3.0, cpu_s=1.0)
    page = text([Outcome.of(METHODS["e2e-rl"], [row], {})], "command", "picture")
    assert cells(page, "end-to-end RL, trained on each")[3] == "(0.16)"
    assert cells(page, "end-to-end RL", "-")[0] == "-"  # nobody says how it was trained


def test_the_listing_has_what_the_tables_have(outcomes):
    found = {(entry["method"], entry["task"]): entry for entry in listing(outcomes)}
    assert len(found) == 5
    box = found["sumo", "spot/move_box"]
    assert (box["successes"], box["trials"], box["published_rate"]) == (2, 3, 0.85)
    assert (box["mean_time_s"], box["mean_cpu_s"], box["seeds"]) == (5.0, 2.5, [1, 2, 3])
    assert found["e2e-mpc", "spot/joints_move_box"]["mean_time_s"] is None
    assert found["hrl", "spot/move_box"]["policy"] == ORIGIN


def test_the_picture_has_every_method_and_is_the_same_every_time(outcomes):
    drawn = picture(outcomes)
    assert picture(outcomes) == drawn
    assert len(drawn) < 200_000
    said = "".join(ET.fromstring(drawn).itertext())
    for word in ("Sumo", "end-to-end MPC", "hierarchical RL", "the paper's rate", *OBJECTS):
        assert word in said


def test_all_tasks_of_the_methods_are_there():
    for method in METHODS.values():
        for family, rates in method.published.items():
            assert len(rates) == len(OBJECTS)
            assert {method.task(family, thing) for thing in OBJECTS} <= {*task_names()}
