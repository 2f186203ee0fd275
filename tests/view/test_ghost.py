"""Where a plan leads is what the planner's own rollout of it says."""

import mujoco
import numpy as np
import pytest
from sumo_dist.view.ghost import WAY_POINTS, Foresight, GhostLog

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.replay import reports
from sumo_dist.view.rrd_file import RrdFile


@pytest.fixture
def ahead(move_box, short_run):
    """The states that the second plan of a short run leads through."""
    plan = list(reports(short_run))[1].plan
    foresight = Foresight(move_box, EpisodeConfig.of(short_run.config["episode"]))
    start = short_run.estimates[plan.tick], short_run.memories[plan.tick]
    yield foresight.end_of(plan, plan.tick, *start)
    foresight.close()


def test_a_plan_is_rolled_out_to_its_end(ahead, move_box, short_run):
    config = EpisodeConfig.of(short_run.config["episode"])
    plan = list(reports(short_run))[1].plan
    problem = Problem.build(move_box, planning_options(config.planner))
    commands = move_box.actions.commands(plan.at(np.arange(plan.tick, plan.tick + 10)))
    start = short_run.estimates[plan.tick], short_run.memories[plan.tick]
    with problem.engine(1) as engine:
        expected = engine.rollout(*start, commands[None]).states[0]
    assert len(ahead) == 10  # 0.2 s
    assert np.array_equal(ahead, expected)


def test_the_twin_stands_where_the_plan_ends(ahead, move_box, tmp_path, read_rrd):
    model = compile_model(move_box.scene, PLANT)
    with Outputs("test", RrdFile(tmp_path / "a.rrd", pytest.fail)) as out:
        log = GhostLog(out, move_box, model)
        log.show(5, ahead)
    timed = read_rrd(tmp_path / "a.rrd").timed
    data = mujoco.MjData(model)
    data.qpos[:] = ahead[-1][: model.nq]
    mujoco.mj_kinematics(model, data)
    way = np.array(timed["/world/plan/way"]["LineStrips3D:strips"][0][0])
    assert len(way) == WAY_POINTS
    assert way[-1][:2] == pytest.approx(data.body("body").xpos[:2], abs=1e-5)
    moving = model.body_weldid[model.geom_bodyid] != 0
    boxes = moving & (model.geom_group < 3) & (model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
    drawn = np.array(timed["/world/plan/end/boxes"]["Boxes3D:centers"][0])
    assert {"boxes", "capsules"} <= {name.rpartition("/")[2] for name in timed}
    for centre in data.geom_xpos[boxes]:  # of robot and object
        assert np.linalg.norm(drawn - centre, axis=1).min() < 1e-5


def test_what_cannot_be_rolled_out_leaves_the_rest_of_the_view(move_box, short_run, monkeypatch):
    from sumo_dist.errors import SumoError

    def unable(*_):
        raise SumoError("no policy here")

    monkeypatch.setattr(Problem, "build", unable)
    plan = next(iter(reports(short_run))).plan
    foresight = Foresight(move_box, EpisodeConfig.of(short_run.config["episode"]))
    start = short_run.estimates[0], short_run.memories[0]
    assert foresight.end_of(plan, 0, *start).shape == (0, len(short_run.states[0]))
