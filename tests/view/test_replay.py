from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.record.rows import Rows
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK
from sumo_dist.view.replay import to_rrd


@pytest.fixture(scope="module")
def rrd(short_run, tmp_path_factory, read_rrd):
    path = tmp_path_factory.mktemp("replay") / "run.rrd"
    to_rrd(short_run, path)
    return read_rrd(path)


def test_every_body_is_where_mujoco_puts_it(rrd, short_run):
    model = compile_model(load_task("spot/move_box").scene, PLANT)
    data = mujoco.MjData(model)
    poses = rrd.timed["/world/poses"]
    frames = [frame[0] for frame in poses["Transform3D:child_frame"]]
    assert {"body", "arm_link_fngr", "box"} <= set(frames)
    assert len(frames) == len(short_run.states) * len(set(frames))
    for row in range(0, len(frames), 37):
        tick = round(poses["sim_time"][row].total_seconds() / 0.02)
        data.qpos[:] = short_run.states[tick][: model.nq]
        mujoco.mj_kinematics(model, data)
        sent = poses["Transform3D:translation"][row][0]
        assert np.allclose(sent, data.body(frames[row]).xpos, atol=1e-5)


def test_each_plan_shows_its_candidates_and_its_elites_apart(rrd, short_run):
    samples, elites = rrd.timed["/world/plan/samples"], rrd.timed["/world/plan/elites"]
    assert len(samples["sim_time"]) == len(short_run.plan_ticks)
    for i, tick in enumerate(short_run.plan_ticks):
        assert samples["sim_time"][i].total_seconds() == pytest.approx(tick * 0.02)
        order = np.argsort(short_run.costs[i], kind="stable")
        best = np.array(elites["LineStrips3D:strips"][i])  # 3 elites x (gripper, object)
        assert np.allclose(best, short_run.traces[i][order[:3]].reshape(6, -1, 3))
        others = np.array(samples["LineStrips3D:strips"][i])
        assert np.allclose(others, short_run.traces[i][order[:2:-1]].reshape(6, -1, 3))


def test_candidates_that_diverged_are_not_drawn(short_run, tmp_path, read_rrd):
    lost = [np.where(np.arange(6) == 2, np.inf, row) for row in short_run.costs]
    run = replace(short_run, costs=lost)
    to_rrd(run, tmp_path / "run.rrd")
    samples = read_rrd(tmp_path / "run.rrd").timed["/world/plan/samples"]
    assert {len(strips) for strips in samples["LineStrips3D:strips"]} == {(6 - 1 - 3) * 2}


def test_plots_hold_the_recorded_numbers_under_their_names(rrd, short_run):
    cost = np.array(rrd.timed["/plots/cost"]["Scalars:scalars"])
    expected = [[c[0], c.min(), c.mean()] for c in short_run.costs]
    assert np.allclose(cost, expected)
    terms = np.array(rrd.timed["/plots/terms"]["Scalars:scalars"])
    assert np.allclose(terms, short_run.terms)


def test_a_long_run_shows_the_candidates_of_every_so_many_plans(short_run, tmp_path, read_rrd):
    size = sum(traces.nbytes for traces in short_run.traces)
    to_rrd(short_run, tmp_path / "run.rrd", candidates_limit=size // 2)
    samples = read_rrd(tmp_path / "run.rrd").timed["/world/plan/samples"]
    shown = [round(t.total_seconds() / 0.02) for t in samples["sim_time"]]
    assert shown == short_run.plan_ticks[::2].tolist()


def test_a_run_without_traces_shows_the_rest(short_run, tmp_path, read_rrd):
    to_rrd(replace(short_run, traces=Rows()), tmp_path / "run.rrd")
    timed = read_rrd(tmp_path / "run.rrd").timed
    assert "/world/plan/samples" not in timed
    assert len(timed["/plots/timing"]["sim_time"]) == len(short_run.plan_ticks)


def test_a_file_that_cannot_be_written_is_an_error(short_run, tmp_path):
    with pytest.raises(SumoError, match="cannot be written"):
        to_rrd(short_run, tmp_path / "no" / "run.rrd")


def test_a_config_of_another_kind_is_a_usage_error(short_run, tmp_path):
    for config in ({"task": "spot/move_box", "seed": 1}, {"episode": {"task": "spot/move_box"}}):
        with pytest.raises(UsageError, match=r"an episode of another version: needs \['clock'"):
            to_rrd(replace(short_run, config=config), tmp_path / "a.rrd")


@pytest.mark.parametrize(
    ("ending", "said"),
    [
        ("timeout", "the run has ended: timeout"),
        ("stopped by a: enough, the robot sat down", None),
        ("", "it ends here"),  # of a run that is not over
    ],
)
def test_the_ending_is_the_last_event(short_run, tmp_path, read_rrd, ending, said):
    to_rrd(replace(short_run, ending=ending), tmp_path / "run.rrd")
    events = read_rrd(tmp_path / "run.rrd").timed["/events"]
    assert events["TextLog:text"] == [[said or f"the run has ended: {ending}"]]
    last = (len(short_run.states) - 1) * TICK
    assert events["sim_time"][0].total_seconds() == pytest.approx(last)


def test_the_goal_is_drawn_where_each_plans_parameters_have_it(short_run, tmp_path, read_rrd):
    """At the start, and again when it moves; the distance in the plot is to the one of the time."""
    table = load_task("spot/move_box").table
    moved = table.adjusted((), ("goal=1.5,0.5",)).parameters
    parameters = np.array(short_run.parameters)
    parameters[4:] = moved
    to_rrd(replace(short_run, parameters=Rows(parameters)), tmp_path / "run.rrd")
    rrd = read_rrd(tmp_path / "run.rrd").timed
    points = rrd["/world/goal/point"]
    assert np.allclose(points["Points3D:positions"], [[[0, 0, 0.254]], [[1.5, 0.5, 0.254]]])
    times = [time.total_seconds() for time in points["sim_time"]]
    assert times == pytest.approx([0.0, short_run.plan_ticks[4] * TICK])
    rings = np.array(rrd["/world/goal/rings"]["LineStrips3D:strips"][1])
    assert np.allclose(rings.mean(axis=(0, 1))[:2], [1.5, 0.5], atol=0.01)


def test_a_recording_whose_task_is_gone_shows_the_same_world(rrd, short_run, tmp_path, read_rrd):
    config = short_run.config
    gone = {**config, "episode": {**config["episode"], "task": "/gone/my_task.py"}}
    to_rrd(replace(short_run, config=gone), tmp_path / "run.rrd")
    again = read_rrd(tmp_path / "run.rrd")
    for column in ("sim_time", "Transform3D:child_frame", "Transform3D:translation"):
        assert again.timed["/world/poses"][column] == rrd.timed["/world/poses"][column]
    seen = [{e: t for e, t in r.static.items() if e.startswith("/world")} for r in (rrd, again)]
    assert seen[0].keys() == seen[1].keys()
    assert len(seen[0]) > 10
