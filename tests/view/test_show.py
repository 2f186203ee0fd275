"""What a loop of one's own shows, live and as a file."""

import urllib.request

import numpy as np
import pytest

import sumo_dist as sd
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.view.replay import to_rrd

QUICK = {"rollouts": 4, "horizon": 0.4}
TICKS = 12


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A loop with a page, saved halfway and at the end, and its recording."""
    folder = tmp_path_factory.mktemp("shown")
    with sd.MPC("spot/move_box", seed=1, planner=QUICK, threads=1) as mpc, sd.show(mpc) as view:
        assert view.address is not None
        page = urllib.request.urlopen(view.address, timeout=60).read()
        html = view._repr_html_()
        robot = sd.Plant(mpc.task.scene, mpc.start(seed=1))
        for _ in range(TICKS):
            view.state(robot.truth)
            robot.send(mpc.step(robot.truth))
            robot.advance()
            if mpc.tick == TICKS / 2:
                view.save(folder / "half.rrd")
        view.state(robot.truth)
        view.say("done")
        view.save(str(folder / "whole.rrd"))
    assert view.address.replace("&", "&amp;") in html
    assert b"<html" in page.lower()
    return folder, mpc.recording


def test_a_loop_shows_what_its_recording_does(shown, tmp_path, read_rrd):
    folder, recording = shown
    to_rrd(recording, tmp_path / "run.rrd")
    whole, run = read_rrd(folder / "whole.rrd"), read_rrd(tmp_path / "run.rrd")
    assert set(run.timed) <= set(whole.timed)
    assert set(run.static) <= set(whole.static)
    assert "done" in str(whole.timed["/events"])
    for entity in ("/world/plan/elites", "/world/plan/samples"):
        ours, theirs = whole.timed[entity], run.timed[entity]
        for column in theirs:
            assert column.endswith("RowId") or ours[column] == theirs[column], column


def test_it_can_be_saved_at_any_time(shown, read_rrd):
    folder, _ = shown

    def last(name):
        return max(max(rows["sim_time"]) for rows in read_rrd(folder / name).timed.values())

    assert last("half.rrd") < last("whole.rrd")


def test_a_view_of_a_task_is_told_states_and_plans(short_run, tmp_path, read_rrd):
    with sd.show("spot/move_box", viewer="none", param={"goal": (1, 0)}) as view:
        assert view.address is None and "save" in view._repr_html_()
        for tick in (0, 1, 5):
            view.state(short_run.states[tick], tick)
        view.state(short_run.states[6])
        view.wait()
        view.save(tmp_path / "a.rrd")
    rrd = read_rrd(tmp_path / "a.rrd")
    times = {time.total_seconds() for rows in rrd.timed.values() for time in rows["sim_time"]}
    assert {0.0, 0.02, 0.1, 0.12} <= {round(time, 3) for time in times}
    assert "/world/goal/point" in rrd.static | rrd.timed


def test_what_cannot_be_shown_is_one_line(short_run, tmp_path):
    state = short_run.states[0]
    with sd.show("spot/move_box", viewer="none") as view:
        view.state(state, 3)
        for wrong, said in [
            (lambda: view.state(state, 2), "tick 2 comes after tick 3: time does not go back"),
            (lambda: view.state(state[:5]), "finite numbers, 33 of qpos"),
            (lambda: view.state(state * np.nan), "finite numbers"),
            (lambda: view.save(tmp_path / "a.mp4"), "save writes Rerun's files, NAME.rrd"),
            (lambda: view.save(tmp_path / "no" / "a.rrd"), "No such file or directory"),
            (lambda: sd.show("spot/juggle"), "unknown task 'spot/juggle'"),
            (lambda: sd.show("spot/move_box", viewer="tv"), "unknown viewer 'tv'; valid: "),
            (lambda: sd.show("spot/move_box", param={"gaol": 1}), "unknown parameter 'gaol'"),
            (lambda: sd.show(7), "task must be a Task, a name or the path of a task file, got 7"),
        ]:
            with pytest.raises((UsageError, SumoError)) as caught:
                wrong()
            assert said in str(caught.value) and "\n" not in str(caught.value)


def test_an_mpc_has_its_own_settings():
    said = "an MPC has settings and parameters of its own"
    with sd.MPC("spot/move_box", planner=QUICK) as mpc, pytest.raises(UsageError, match=said):
        sd.show(mpc, planner=QUICK)


def test_a_film_stays_in_a_notebook(short_run, tmp_path):
    made = sd.film(short_run, str(tmp_path / "run.jpg"))
    assert made._repr_html_().startswith('<img src="data:image/jpeg;base64,/9j/')
    with pytest.raises(UsageError, match=r"unknown film format '\.avi'"):
        sd.film(short_run, tmp_path / "run.avi")
