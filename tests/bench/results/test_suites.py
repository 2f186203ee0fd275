"""The suites against what the paper prints."""

import pytest

from sumo_dist.bench.results.suites import SUITES
from sumo_dist.tasks import task_names

G1 = {
    "g1/box_push": (9, 10, 11.83),
    "g1/chair_push": (10, 10, 6.86),
    "g1/door_open": (10, 10, 4.73),
    "g1/table_push": (8, 10, 4.86),
}


def test_the_papers_figures_of_g1():
    figures = SUITES["paper-g1"].figures
    assert {name: tuple(figure) for name, figure in figures.items()} == G1
    assert str(figures["g1/box_push"]) == "0.90, 11.83 s"


@pytest.mark.parametrize("suite", SUITES.values(), ids=lambda suite: suite.name)
def test_suites_name_tasks_that_there_are(suite):
    assert set(suite.figures) | set(suite.controls) <= set(task_names())
