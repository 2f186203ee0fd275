import urllib.request
from copy import deepcopy
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.record.rows import Rows
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK
from sumo_dist.view import replay
from sumo_dist.view.marks import TRACE_POINTS, thinned
from sumo_dist.view.replay import to_rrd
from sumo_dist.view.viewers import Viewer


def cut(recording, ticks):
    """Return a copy of the recording with so many ticks."""
    copy = deepcopy(recording)
    copy.cut(ticks, len(copy.plan_ticks))
    return copy


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


def test_ten_plans_a_second_show_their_candidates_and_their_elites_apart(rrd, short_run):
    samples, elites = rrd.timed["/world/plan/samples"], rrd.timed["/world/plan/elites"]
    shown = range(0, len(short_run.plan_ticks), 2)
    assert len(samples["sim_time"]) == len(elites["sim_time"]) == len(shown)
    for row, i in enumerate(shown):
        tick = short_run.plan_ticks[i]
        assert samples["sim_time"][row].total_seconds() == pytest.approx(tick * TICK)
        order = np.argsort(short_run.costs[i], kind="stable")
        best = np.array(elites["LineStrips3D:strips"][row])  # 3 elites x (gripper, object)
        assert np.allclose(best, short_run.traces[i][order[:3]].reshape(6, -1, 3))
        others = np.array(samples["LineStrips3D:strips"][row])
        points = thinned(short_run.traces[i].shape[2], TRACE_POINTS)
        expected = short_run.traces[i][order[:2:-1]][:, :, points]
        assert np.allclose(others, expected.reshape(6, -1, 3))


def test_candidates_that_diverged_are_not_drawn(short_run, tmp_path, read_rrd):
    lost = [np.where(np.arange(6) == 2, np.inf, row) for row in short_run.costs]
    run = replace(short_run, costs=lost)
    to_rrd(run, tmp_path / "run.rrd")
    samples = read_rrd(tmp_path / "run.rrd").timed["/world/plan/samples"]
    assert {len(strips) for strips in samples["LineStrips3D:strips"]} == {(6 - 1 - 3) * 2}


def test_plots_hold_the_recorded_numbers_under_their_names(rrd, short_run):
    cost = np.array(rrd.timed["/plots/cost"]["Scalars:scalars"])
    expected = [[c[0], c.min(), np.median(c)] for c in short_run.costs]
    assert np.allclose(cost, expected)
    terms = np.array(rrd.timed["/plots/terms"]["Scalars:scalars"])
    assert np.allclose(terms, short_run.terms)


def test_a_long_run_shows_the_candidates_of_every_so_many_plans(short_run, tmp_path, read_rrd):
    size = sum(traces.nbytes for traces in short_run.traces)
    to_rrd(short_run, tmp_path / "run.rrd", candidates_limit=size // 4)
    samples = read_rrd(tmp_path / "run.rrd").timed["/world/plan/samples"]
    shown = [round(t.total_seconds() / 0.02) for t in samples["sim_time"]]
    assert shown == short_run.plan_ticks[::4].tolist()


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


def test_a_second_of_a_run_takes_at_most_half_a_megabyte(short_run, tmp_path):
    """Of what changes: the scene itself is written once."""
    to_rrd(short_run, tmp_path / "run.rrd")
    to_rrd(cut(short_run, 1), tmp_path / "one.rrd")
    size = [(tmp_path / name).stat().st_size for name in ("run.rrd", "one.rrd")]
    assert size[0] - size[1] < 500_000 * len(short_run.states) * TICK


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_file_is_in_the_order_of_time(short_run, tmp_path):
    """A viewer that has read a part of it has plots and candidates of that part."""
    long = replace(short_run, states=Rows(np.tile(short_run.states[:1], (600, 1))))
    to_rrd(long, tmp_path / "run.rrd")
    chunks = RrdReader(tmp_path / "run.rrd").stream()
    kinds = [chunk.entity_path for chunk in chunks if not chunk.is_static]
    assert kinds[-20:].count("/world/poses") > 1  # poses go on after them
    assert kinds.index("/world/plan/samples") < len(kinds) // 2


def test_a_recording_is_shown_while_it_is_read(short_run, monkeypatch, capsys):
    """The page is there, and what is read goes to the server that it names."""
    seen = []

    def visit(viewer):
        with urllib.request.urlopen(viewer.address, timeout=60) as response:
            seen.append(response.read())

    order = []
    monkeypatch.setattr(Viewer, "wait", lambda viewer: order.append("waits") or visit(viewer))
    tell = replay._tell
    monkeypatch.setattr(replay, "_tell", lambda viewer: order.append("tells") or tell(viewer))
    log = replay._log
    monkeypatch.setattr(replay, "_log", lambda *args: order.append("logs") or log(*args))
    replay.show(short_run, "web")
    assert order == ["tells", "logs", "waits"]
    assert b"<html" in seen[0]
    assert "watch the run at http://127.0.0.1:" in capsys.readouterr().err
