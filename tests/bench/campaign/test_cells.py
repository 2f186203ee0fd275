from dataclasses import replace

import pytest

from sumo_dist.bench.campaign.campaign import Settings, named_tasks
from sumo_dist.bench.campaign.cells import NAMED, Cell, parse_cells
from sumo_dist.bench.results.suites import PAPER_ANALYSIS
from sumo_dist.errors import UsageError
from sumo_dist.model.scene import PLANT
from sumo_dist.planner.config import PlannerConfig

SHARED = Settings(trials=3, set=("spline=cubic",), time_limit=2.0)


def planner(cell, task="spot/move_box", shared=SHARED):
    return cell.over(shared).episode(task, 1).planner


def test_names_and_settings_are_read_in_the_order_given():
    cells = parse_cells(["icem-8, paper", " mine :optimizer = ps,rollouts=5 ", "default"])
    assert [cell.name for cell in cells] == ["icem-8", "paper", "mine", "default"]
    assert cells[2].settings == {"optimizer": "ps", "rollouts": "5"}


def test_a_cell_goes_over_what_all_cells_share():
    (mine,) = parse_cells(["mine: preset=paper,optimizer=icem,rollouts=12"])
    settings = mine.over(SHARED)
    assert settings == replace(
        SHARED, preset="paper", optimizer="icem", set=("spline=cubic", "rollouts=12")
    )
    found = planner(mine)
    assert (found.rollouts, found.spline, found.base_noise) == (12, "cubic", 1.0)
    assert (found.iterations, found.execute) == (2, "best")  # what makes it iCEM


def test_every_cell_that_has_a_name_plans():
    for cell in NAMED.values():
        planner(cell)
        planner(cell, "g1/box_push")
    assert planner(NAMED["default"], shared=Settings()) == PlannerConfig()
    assert planner(NAMED["paper"], shared=Settings()) == PlannerConfig.preset("paper")
    assert (planner(NAMED["mppi-8"]).optimizer, planner(NAMED["mppi-8"]).rollouts) == ("mppi", 8)


def test_the_reference_searches_as_the_released_code_does_with_the_plants_physics():
    found = planner(NAMED["reference"], shared=Settings())
    assert (found.rollouts, found.horizon, found.nodes, found.elites) == (24, 2.0, 3, 3)
    assert (found.timestep, found.fluid_density) == (PLANT.timestep, PLANT.fluid_density)
    sigma = found.variance_first**0.5, found.variance_last**0.5
    half_ranges = {"arm": 0.924, "base": 0.7}  # geometric mean of the arm's [rad], [m/s]
    noise = {"arm": 1.0, "base": found.base_noise}
    for limb, half_range in half_ranges.items():
        physical = [s * noise[limb] * half_range for s in sigma]
        assert physical == pytest.approx([0.1, 1.0], rel=0.01)


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (["dflt"], "unknown cell 'dflt'; valid: 'NAME: key=value,key=value', cem-16, cem-32, cem"),
        ([""], "unknown cell ''; valid: "),
        (["default,"], "unknown cell ''; valid: "),
        (["paper,default,paper"], "cell paper is given twice; every cell needs its own name"),
        (["a: rollouts=2", "a: rollouts=3"], "cell a is given twice"),
        (["paper: rollouts=2"], "cell paper has settings of its own; give yours another name"),
        (["a: rollouts=2,rollouts=3"], "cell a: rollouts is given twice; once is valid"),
        (["a:"], "cell a: '' is not key=value, as in 'NAME: key=value,key=value'"),
        (["a: rollouts"], "cell a: ' rollouts' is not key=value"),
        (["../a: rollouts=2"], "cell '../a' is not a valid name: up to 64 of"),
        ([": rollouts=2"], "cell '' is not a valid name"),
    ],
)
def test_what_is_no_cell_is_one_error(texts, said):
    with pytest.raises(UsageError) as caught:
        parse_cells(texts)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_setting_is_either_of_all_cells_or_of_one():
    with pytest.raises(UsageError, match="--set spline=cubic is for all cells, and a has its own"):
        Cell("a", {"spline": "zero"}).over(SHARED)


def test_suites_and_tasks_are_named_alike_and_once():
    found = named_tasks("g1/box_push,paper-analysis,spot/move_box")
    assert found == ["g1/box_push", *PAPER_ANALYSIS.figures]
    with pytest.raises(
        UsageError, match=r"unknown task 'nope'; valid: .* paper-g1, paper-spot, spot/"
    ):
        named_tasks("nope")
