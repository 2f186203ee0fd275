"""Plots: progress of every task against its threshold, and no peak that hides the rest."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.episode.referee import Referee
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.tasks import load_task, task_names
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.plots import FLEET, PlotLog, plots
from sumo_dist.view.rrd_file import RrdFile

PLAN = Plan(0, 0, np.zeros((4, 2), np.float32), 1.5, "linear")


def report(task, costs, terms, plan_ms=20.0):
    table = task.table.defaults
    plan = replace(PLAN, tick=0)
    finite = np.isfinite(costs)
    told = np.where(finite, costs, 0.0), finite, np.array(terms), table.weights, table.parameters
    return PlanReport(plan, *told, plan_ms, 1.0)


def logged(task, path, read_rrd, fill):
    with Outputs("test", RrdFile(path, pytest.fail)) as out:
        log = PlotLog(out, task, plots(task, True, ()))
        fill(log)
        log.flush()
    return read_rrd(path)


@pytest.mark.parametrize("name", task_names())
def test_every_task_shows_its_progress_and_where_it_is_solved(name, tmp_path, read_rrd):
    task = load_task(name)
    view = Referee(task, compile_model(task.scene, PLANT)).view(draw_start(task, 1))
    goal = task.goal_position(view.p)
    rrd = logged(task, tmp_path / "a.rrd", read_rrd, lambda log: log.add_state(0, view, goal))
    shown = plots(task, False, ()).progress
    values = [rrd.timed[f"/plots/{plot.origin}"]["Scalars:scalars"][0] for plot in shown]
    assert all(len(value) == 2 and value[1] > 0 for value in values)  # and its limit
    assert not all(value < limit for value, limit in values)  # no start is solved
    for plot in shown:
        assert rrd.static[f"/plots/{plot.origin}"]["SeriesLines:names"] == [list(plot.lines)]


def test_an_upright_task_shows_the_angle_to_upright(tmp_path, read_rrd):
    task = load_task("spot/upright_cone")
    state = draw_start(task, 1)
    referee = Referee(task, compile_model(task.scene, PLANT))
    view = referee.view(state)
    rrd = logged(task, tmp_path / "a.rrd", read_rrd, lambda log: log.add_state(0, view, None))
    tilt, limit = rrd.timed["/plots/progress/0"]["Scalars:scalars"][0]
    assert tilt == pytest.approx(np.arccos(view.object.z[0, 0, 2]))
    assert limit == task.table.named(referee.parameters).success_tilt
    assert plots(task, False, ()).progress[0].title == "Object's tilt [rad]"


def test_a_task_whose_test_is_a_function_shows_goal_and_test(move_box, tmp_path, read_rrd):
    task = replace(move_box, success=lambda r: r.object.pos[..., 2] > 9.0)
    view = Referee(task, compile_model(task.scene, PLANT)).view(draw_start(task, 1))
    goal = task.goal_position(view.p)
    rrd = logged(task, tmp_path / "a.rrd", read_rrd, lambda log: log.add_state(0, view, goal))
    assert rrd.timed["/plots/progress/success"]["Scalars:scalars"] == [[0.0]]
    away = np.linalg.norm(view.object.pos[0, 0] - goal)
    assert rrd.timed["/plots/progress/goal"]["Scalars:scalars"] == [[pytest.approx(away)]]


def test_one_candidate_that_falls_hides_nothing(move_box, tmp_path, read_rrd):
    calm = np.linspace(100.0, 110.0, 16)
    falls = calm + 2500.0 * (np.arange(16) == 0)

    def fill(log):
        log.add_plan(report(move_box, calm, [90.0, 8.0, 2.0, 0.0]), 50.0)
        log.add_plan(report(move_box, falls, [90.0, 8.0, 2.0, 2500.0]), 50.0)

    timed = logged(move_box, tmp_path / "a.rrd", read_rrd, fill).timed
    first, second = timed["/plots/cost"]["Scalars:scalars"]
    assert first == pytest.approx([calm[0], calm.min(), np.median(calm)])  # nothing is cut
    assert max(second) < 2 * max(first)
    assert second[1:] == pytest.approx([falls.min(), np.median(falls)])
    assert timed["/plots/terms"]["Scalars:scalars"][1] == pytest.approx([90.0, 8.0, 2.0, 108.0])


def test_costs_below_zero_are_not_cut(move_box, tmp_path, read_rrd):
    costs = np.array([-20.0, -30.0, -10.0, -25.0])
    rrd = logged(
        *(move_box, tmp_path / "a.rrd", read_rrd),
        lambda log: log.add_plan(report(move_box, costs, [0.0] * 4), 50.0),
    )
    assert rrd.timed["/plots/cost"]["Scalars:scalars"] == [[-20.0, -30.0, -22.5]]


@pytest.mark.parametrize(("took", "shown"), [(30.0, 30.0), (2000.0, 200.0)])
def test_the_budget_is_seen_beside_a_plan_that_is_very_late(
    took, shown, move_box, tmp_path, read_rrd
):
    rrd = logged(
        *(move_box, tmp_path / "a.rrd", read_rrd),
        lambda log: log.add_plan(report(move_box, np.ones(4), [1.0] * 4, took), 50.0),
    )
    assert rrd.timed["/plots/timing"]["Scalars:scalars"] == [[shown, 1.0, 50.0]]


@pytest.mark.parametrize(("age", "shown"), [(40.0, 40.0), (5000.0, 400.0)])
def test_when_a_plan_is_old_is_seen_beside_one_that_is_very_old(
    age, shown, move_box, tmp_path, read_rrd
):
    rrd = logged(move_box, tmp_path / "a.rrd", read_rrd, lambda log: log.add_age(3, age, 100.0))
    assert rrd.timed["/plots/age"]["Scalars:scalars"] == [[shown, 100.0]]


def test_rollouts_that_came_in_time_are_told_from_those_asked_for(move_box, tmp_path, read_rrd):
    told = replace(report(move_box, np.ones(8), [1.0] * 4), lost=3, reissued=2)
    rrd = logged(move_box, tmp_path / "a.rrd", read_rrd, lambda log: log.add_plan(told, 50.0))
    assert rrd.timed["/plots/rollouts"]["Scalars:scalars"] == [[5.0, 2.0, 8.0]]


def test_plots_name_their_lines_and_workers_have_theirs_in_sight(move_box):
    alone, together = plots(move_box, False, ()), plots(move_box, True, ("robot on floor",))
    assert not alone.fleet
    assert together.fleet == FLEET
    named = {plot.origin: plot.lines for plot in together.tune}
    assert named["terms"] == tuple(term.name for term in move_box.cost)
    assert named["off"] == ("base", "gripper", "object")
    assert named["forces"] == ("robot on floor",)
    origins = [plot.origin for plot in together.all]
    assert len(origins) == len(set(origins))
