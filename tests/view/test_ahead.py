"""Where a plan leads is what the planner's own rollout of it says."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.view.ahead import WAY_POINTS, AheadLog
from sumo_dist.view.charts import WIDTH
from sumo_dist.view.forces import Forces
from sumo_dist.view.foresight import Allowance, Foresight
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.plots import LEAD_TICKS, PlotLog, plots
from sumo_dist.view.replay import reports
from sumo_dist.view.rrd_file import RrdFile
from sumo_dist.view.search import SearchLog


@pytest.fixture
def second(short_run):
    """The second plan of a short run."""
    return list(reports(short_run))[1]


@pytest.fixture
def config(short_run):
    return EpisodeConfig.of(short_run.config["episode"])


@pytest.fixture
def start(short_run, second):
    """State and memory that the second plan starts from."""
    tick = second.plan.tick
    return short_run.estimates[tick], short_run.memories[tick]


@pytest.fixture
def ahead(move_box, config, second, start):
    """What the second plan leads through."""
    foresight = Foresight(move_box, config)
    yield foresight.of(second.plan, second.plan.tick, *start, second.parameters)
    foresight.close()


@pytest.fixture
def model(move_box):
    return compile_model(move_box.scene, PLANT)


@pytest.fixture
def drawn(move_box, model, tmp_path, read_rrd):
    """A function that draws what another one logs; returns what has a time, and the log."""

    def drawn(log):
        with Outputs("test", RrdFile(tmp_path / "a.rrd", pytest.fail)) as out:
            forces = Forces(model, move_box.scene.robot.base)
            rows = PlotLog(out, move_box, plots(move_box, False, forces.pairs))
            log(AheadLog(out, move_box, model, rows))
            rows.flush()
        return read_rrd(tmp_path / "a.rrd").timed

    return drawn


def test_a_plan_is_rolled_out_to_its_end(ahead, move_box, config, second, start):
    problem = Problem.build(move_box, planning_options(config.planner))
    unit = second.plan.at(np.arange(second.plan.tick, second.plan.tick + 10))
    with problem.engine(1) as engine:
        expected = engine.rollout(*start, move_box.actions.commands(unit)[None])
    assert len(ahead.states) == 10  # 0.2 s
    assert np.array_equal(ahead.states, expected.states[0])
    assert np.array_equal(ahead.targets, expected.targets[0])


def test_the_twin_stands_where_the_plan_ends(ahead, drawn, model, second):
    data = mujoco.MjData(model)
    data.qpos[:] = ahead.states[-1][: model.nq]
    mujoco.mj_kinematics(model, data)
    timed = drawn(lambda log: log.show(ahead, second))
    twin = timed["/world/plan/twin/poses"]
    at = {
        frame[0]: place[0]
        for frame, place in zip(
            twin["Transform3D:child_frame"], twin["Transform3D:translation"], strict=True
        )
    }
    for body in ("body", "object", "arm_link_wr1"):  # of robot and object
        if f"plan of {body}" in at:
            assert at[f"plan of {body}"] == pytest.approx(data.body(body).xpos, abs=1e-5)
    assert {"plan of body", "plan of box"} <= at.keys()
    way = np.array(timed["/world/plan/way/base"]["LineStrips3D:strips"][0][0])
    assert len(way) == WAY_POINTS
    assert way[-1][:2] == pytest.approx(data.body("body").xpos[:2], abs=1e-5)


def test_the_cost_along_a_plan_has_the_planners_cost_as_its_mean(
    ahead, move_box, config, second, start
):
    problem = Problem.build(move_box, planning_options(config.planner))
    with problem.engine(1) as engine:
        evaluator = Evaluator(problem, engine, config.planner)
        found = evaluator(*start, second.parameters, second.plan.knots[None]).terms[0]
    for term, value in zip(move_box.cost, found, strict=True):
        course = term.course(ahead.view)
        assert course.shape == (1, 10)
        mean = course.max() if term.reduction == "any" else course.mean()
        assert mean == pytest.approx(value, rel=1e-12), term.name


def test_each_term_is_named_beside_its_line(ahead, drawn, move_box, second):
    timed = drawn(lambda log: log.show(ahead, second))
    names = [word.split()[0] for word in timed["/charts/terms/words"]["Points2D:labels"][0]]
    assert set(names) >= {term.name for term in move_box.cost}


def test_a_plan_is_compared_with_what_came(ahead, drawn, config, move_box, second, start):
    later = replace(second.plan, horizon=1.0)
    foresight = Foresight(move_box, config)
    longer = foresight.of(later, later.tick, *start, second.parameters)
    foresight.close()
    then = longer.tick + LEAD_TICKS

    def log(log):
        log.show(longer, second)
        for tick in range(longer.tick + 1, then + 1):
            log.reached(tick, ViewAt(longer, tick - longer.tick - 1, 0.3))

    timed = drawn(log)
    [off] = timed["/plots/off"]["Scalars:scalars"]
    assert off == pytest.approx([0.3, 0.3, 0.3])
    assert round(timed["/plots/off"]["sim_time"][0].total_seconds() / 0.02) == then
    assert len(timed["/plots/forces"]["Scalars:scalars"]) == LEAD_TICKS


class ViewAt:
    """What came at a step of a rollout, moved aside."""

    def __init__(self, ahead, step, aside):
        self._ahead, self._step, self._aside = ahead, step, aside

    def __getitem__(self, name):
        frame = self._ahead.view[name]
        return replace(frame, pos=frame.pos[:, self._step : self._step + 1] + [0, self._aside, 0])


def test_what_cannot_be_rolled_out_leaves_the_rest_of_the_view(
    move_box, config, second, start, monkeypatch
):
    from sumo_dist.errors import SumoError

    def unable(*_):
        raise SumoError("no policy here")

    monkeypatch.setattr(Problem, "build", unable)
    foresight = Foresight(move_box, config)
    assert foresight.of(second.plan, 0, *start, second.parameters) is None


def test_a_standing_robot_presses_on_the_floor_with_its_weight(move_box, config, model, start):
    still = move_box.actions.unit(move_box.actions.default)
    stands = np.repeat(still[None], 4, axis=0).astype(np.float32)
    foresight = Foresight(move_box, config)
    ahead = foresight.of(
        Plan(0, 0, stands, 1.0, "linear"), 0, *start, config.cost(move_box).parameters
    )
    foresight.close()
    forces = Forces(ahead.model, "body")
    found = forces.along(ahead, 50)[25:].mean(axis=0)
    told = dict(zip(forces.pairs, found, strict=True))
    mass = {n: model.body_subtreemass[model.body(n).id] for n in ("body", "box")}
    assert told["robot on floor"] == pytest.approx(9.81 * mass["body"], rel=0.1)
    assert told["box on floor"] == pytest.approx(9.81 * mass["box"], rel=0.1)
    assert told["robot on box"] == 0.0


def test_knots_are_drawn_with_the_noise_that_the_planner_draws(
    move_box, config, second, tmp_path, read_rrd
):
    with Outputs("test", RrdFile(tmp_path / "a.rrd", pytest.fail)) as out:
        log = SearchLog(out, move_box.actions, config.planner)
        log.show(second.plan)
        log.follow(replace(config.planner, nodes=7))
        log.show(second.plan)  # of the settings before: left out
    drawn = read_rrd(tmp_path / "a.rrd").timed
    [words] = drawn["/charts/knots/words"]["Points2D:labels"]
    assert {"base_vx", "base_vy", "base_wz", "limbs, mean"} <= set(words)
    strips = [np.array(strip) for strip in drawn["/charts/knots/lines"]["LineStrips2D:strips"][0]]
    bars = [s for s in strips if len(s) == 2 and s[0, 0] == s[1, 0] and 0 <= s[0, 0] <= WIDTH]
    nodes = config.planner.nodes - 1  # the smooth spline's first lies before the plan
    assert len(bars) in {4 * nodes, 4 * config.planner.nodes}  # three velocities and the limbs


def test_what_is_not_needed_keeps_within_its_share(monkeypatch):
    from sumo_dist.view import foresight

    now = [0.0]
    monkeypatch.setattr(foresight.time, "monotonic", lambda: now[0])
    allowance = Allowance(0.1)
    assert allowance.left
    with allowance:
        now[0] += 2.0
    assert not allowance.left
    now[0] += 17.9
    assert not allowance.left
    now[0] += 0.2  # a tenth of 20 s
    assert allowance.left
