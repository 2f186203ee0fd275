"""`sumo-dist run` from outside: what it writes, and what it says to bad input."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from sumo_dist.cli import main
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.observation import Observer
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.policies.fetch import cached
from sumo_dist.policies.manifest import pinned_policy
from sumo_dist.record.folders import last_episode
from sumo_dist.record.recording import Recording
from sumo_dist.tasks import load_task

QUICK = ["--set", "rollouts=6", "--set", "horizon=0.3", "--viewer", "none"]
FREE = ["--listen", "tcp/127.0.0.1:0"]
KEYS = {
    *("task", "robot", "optimizer", "engine", "seed", "config_hash", "success"),
    *("completion_time_s", "end", "end_reason", "estimator", "plans", "plan_ms_p50", "plan_ms_p99"),
    *("missed_deadlines", "partial_plans", "rollouts_lost", "real_time_factor"),
    *("plan_digest", "state_digest", "versions"),
}


def start(*args, **changes):
    """Start sumo-dist in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "sumo_dist", *map(str, args)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **changes},
    )


def finish(process, timeout=60):
    """Return exit code, stdout and stderr."""
    try:
        out, err = process.communicate(timeout=timeout)
    finally:
        process.kill()
    assert "Traceback" not in err
    return process.returncode, out, err


def sumo_dist(*args, **changes):
    return finish(start(*args, **changes))


def refused(capsys, *args):
    """Return the one line by which a run is refused."""
    assert main(["run", *args]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("sumo-dist: ")
    assert err.count("\n") == 1
    return err


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, 2])
def test_a_run_ends_with_one_line_and_writes_its_folder(tmp_path, workers):
    out = tmp_path / "a" / "run"
    args = ["--workers", workers, "--seed", 4, "--time-limit", 0.5, "--out", out, *QUICK, *FREE]
    code, said, told = sumo_dist("run", "spot/move_box", *args)
    assert code == 1  # half a second is not enough
    assert told.endswith(f"see it again: sumo-dist replay {out}\n")
    assert not (out / "run.rrd").exists()  # nobody watches, nobody has asked for it
    assert said.count("\n") == 1
    assert said.startswith("spot/move_box seed 4: not solved: timeout, 10 plans of ")
    assert said.endswith(f"; in {out}\n")
    summary = json.loads((out / "summary.json").read_text())
    assert set(summary) >= KEYS
    assert (summary["seed"], summary["plans"], summary["optimizer"]) == (4, 10, "ps")
    recording = Recording.load(out / "run.npz")
    assert recording.state_digest == summary["state_digest"]
    assert recording.plan_digest == summary["plan_digest"]
    assert len(recording.states) == 26
    assert np.isfinite(recording.terms).all()


def test_a_trace_is_written_without_a_viewer_if_asked_for(tmp_path, capsys, read_rrd):
    args = ["--workers", "0", "--threads", "1", "--time-limit", "0.2", *QUICK]
    assert main(["run", "spot/move_box", *args, "--rrd", "--out", str(tmp_path / "a")]) == 1
    assert "/world/poses" in read_rrd(tmp_path / "a" / "run.rrd").timed
    assert f"sumo-dist replay {tmp_path / 'a'}" in capsys.readouterr().err


def test_a_learned_policy_drives_in_place_of_the_planner(
    tmp_path, policy_file, monkeypatch, drawn_policy
):
    monkeypatch.chdir(policy_file.parent)
    out = tmp_path / "run"
    args = ["--policy-file", policy_file.name, "--workers", "0", "--viewer", "none"]
    assert main(["run", "spot/move_box", *args, "--time-limit", "0.5", "--out", str(out)]) == 1
    recording = Recording.load(out / "run.npz")
    settings = recording.config["episode"]["planner"]
    assert (settings["policy"], settings["rollouts"]) == (str(policy_file), 1)
    task = load_task("spot/move_box")
    model = Problem.build(task, planning_options(PlannerConfig())).model
    parameters = task.table.named(task.table.defaults.parameters)
    seen = Observer(task, model)(np.array(recording.estimates), parameters)
    decided = drawn_policy("spot/move_box", seed=1)(seen)[recording.plan_ticks]  # (P, 1, n)
    assert np.array_equal(recording.knots, decided.astype(np.float32))


def test_what_is_said_beside_a_learned_policy_wins(tmp_path, policy_file):
    beside = ["--set", "guided=0.5", "--set", "rollouts=4", "--set", "nodes=2"]
    args = ["--policy-file", str(policy_file), "--workers", "0", "--viewer", "none", *beside]
    out = tmp_path / "run"
    assert main(["run", "spot/move_box", *args, "--time-limit", "0.1", "--out", str(out)]) == 1
    settings = Recording.load(out / "run.npz").config["episode"]["planner"]
    assert (settings["guided"], settings["rollouts"], settings["nodes"]) == (0.5, 4, 2)
    assert settings["policy"] == str(policy_file)


def test_a_learned_policy_of_another_robot_is_refused(capsys, policy_file):
    args = ["--policy-file", str(policy_file), "--workers", "0"]
    assert "whose robot is spot cannot do task" in refused(capsys, "g1/box_push", *args)


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["spot/none"], "unknown task 'spot/none'; valid: "),
        (["spot/move_box", "--optimizer", "sgd"], "unknown optimizer 'sgd'; valid: cem, "),
        (["spot/move_box", "--set", "rolouts=3"], "unknown setting 'rolouts'; valid: "),
        (["spot/move_box", "--set", "rollouts=x"], "setting rollouts needs a value of type int"),
        (["spot/move_box", "--set", "rollouts=0"], "rollouts must be from 1 to"),
        (["spot/move_box", "--set", "horizon"], "is not of the form key=value"),
        (["spot/move_box", "--set", "guidance=goal"], "unknown guidance 'goal'; valid: learned, "),
        (["spot/upright_box", "--set", "guidance=object"], "guidance=object is not for task 'spot"),
        (["spot/move_box", "--set", "guidance=learned"], "guidance=learned needs policy=FILE"),
        (["spot/move_box", "--policy-file", "none.onnx"], "cannot read policy file none.onnx on"),
        (["spot/move_box", "--policy-file", __file__], "not an ONNX file"),
        (["spot/move_box", "--weight", "gaol=3"], "unknown cost term 'gaol'; valid: fall, goal, "),
        (["spot/move_box", "--weight", "goal"], "weight 'goal' is not of the form name=number"),
        (["spot/move_box", "--param", "gaol=3"], "unknown parameter 'gaol'; valid: goal, success"),
        (["spot/move_box", "--param", "goal=9,0"], "parameter 'goal' must be from -8 to 8 m"),
        (["spot/move_box", "--param", "goal=1"], "parameter 'goal' needs 2 finite numbers"),
        (["spot/move_box", "--viewer", "tv"], "unknown viewer 'tv'; valid: native, none, web"),
        (["spot/move_box", "--engine", "warp"], "unknown engine 'warp'; valid: auto, fallback"),
        (["spot/move_box", "--clock", "wall"], "unknown clock 'wall'; valid: lockstep, realtime"),
        (["spot/move_box", "--estimator", "x"], "unknown estimator 'x'; valid: lowpass, truth"),
        (["spot/move_box", "--workers", "-1"], "workers must be from 0 to 256, got -1"),
        (["spot/move_box", "--workers", "999"], "workers must be from 0 to 256, got 999"),
        (["spot/move_box", "--threads", "-2"], "threads must be from 1 to 256, got -2"),
        (["spot/move_box", "--threads", "0"], "threads must be from 1 to 256, got 0"),
        (["spot/move_box", "--seed", "-1"], "seed must be a whole number from 0"),
        (["spot/move_box", "--time-limit", "0"], "time limit must be in (0, 3600] s, got 0.0"),
        (["spot/move_box", "--wait", "nan"], "wait must be in (0, 3600] s, got nan"),
        (["spot/move_box", "--listen", "foo"], "'foo' is not an endpoint; valid: tcp/HOST:PORT"),
        (["spot/move_box", "--listen", "foo:0"], "is not an endpoint; valid: tcp/HOST:PORT"),
        (["spot/move_box", "--speed", "fast"], "speed must be auto or a number in (0, 100]"),
        (
            ["spot/move_box", "--clock", "realtime", "--workers", "0"],
            "the realtime clock plans asynchronously: it needs at least one worker",
        ),
    ],
)
def test_bad_input_is_one_line_that_says_what_is_valid(capsys, tmp_path, args, message):
    assert message in refused(capsys, *args, "--out", str(tmp_path))


def test_weights_and_parameters_are_those_of_the_run(tmp_path, capsys):
    numbers = ["--weight", "gripper=-9", "--weight", "goal=1e-3", "--param", "goal=1,-1"]
    args = ["--workers", "0", "--time-limit", "0.1", "--out", str(tmp_path), *numbers, *QUICK]
    assert main(["run", "spot/move_box", *args]) == 1
    assert capsys.readouterr().out.endswith(f"; in {tmp_path}\n")
    recording = Recording.load(tmp_path / "run.npz")
    assert recording.config["episode"]["weight"] == ["gripper=-9", "goal=1e-3"]
    assert recording.config["episode"]["param"] == ["goal=1,-1"]
    assert recording.weights[0].tolist() == [1e-3, -9.0, 20.0, 2500.0]
    assert recording.parameters[0].tolist() == [1.0, -1.0, 0.1, 0.05]


def test_a_run_leaves_no_episodes_of_the_one_before_in_its_folder(tmp_path):
    """And the line at its end is of its last one."""
    for number in ("2", "3", "12"):
        (tmp_path / f"episode-{number}").mkdir()
        (tmp_path / f"episode-{number}" / "summary.json").write_text("{}")
    assert last_episode(tmp_path) == tmp_path / "episode-12"
    (tmp_path / "episode-mine").mkdir()
    args = ["--workers", "0", "--time-limit", "0.1", "--out", str(tmp_path), *QUICK]
    assert main(["run", "spot/move_box", *args]) == 1
    assert [path.name for path in tmp_path.glob("episode-*")] == ["episode-mine"]
    assert last_episode(tmp_path) == tmp_path


@pytest.mark.parametrize("where", ["/proc/none", "{}/a-file"])
def test_a_folder_that_cannot_be_written_is_one_line(capsys, tmp_path, where):
    (tmp_path / "a-file").touch()
    out = where.format(tmp_path)
    assert f"cannot write to {out}: " in refused(capsys, "spot/move_box", "--out", out)


BROKEN = {
    "<mujoco><worldbody><body>": "XML",
    "<mujoco><worldbody><body><geom type='blob' size='1'/></body></worldbody></mujoco>": "blob",
    "<mujoco><worldbody/></mujoco>": "has no body that could be an object",
}
TASK_FILE = """
from dataclasses import replace
from sumo_dist.model.scene import SceneObject
from sumo_dist.tasks import load_task

def task():
    move = load_task("spot/move_box")
    return replace(move, scene=replace(move.scene, objects=(SceneObject("box", "broken.xml"),)))
"""


@pytest.mark.parametrize("mjcf", BROKEN)
def test_a_broken_model_is_one_line_that_names_it(capsys, tmp_path, mjcf):
    (tmp_path / "broken.xml").write_text(mjcf)
    (tmp_path / "my_task.py").write_text(TASK_FILE)
    line = refused(capsys, str(tmp_path / "my_task.py"), "--out", str(tmp_path / "run"))
    assert "broken.xml" in line
    assert BROKEN[mjcf] in line


def test_a_corrupt_policy_file_is_named_with_what_heals_it(tmp_path):
    good = cached(pinned_policy("spot"))
    folder = tmp_path / "policies"
    folder.mkdir()
    (folder / good.name).write_bytes(good.read_bytes()[:-1] + b"x")
    args = ["--workers", "1", "--out", tmp_path / "run", *QUICK, *FREE]
    code, out, err = sumo_dist("run", "spot/move_box", *args, SUMO_DIST_CACHE=str(tmp_path))
    assert (code, out) == (3, "")
    assert f"{good.name} is not the pinned file" in err
    assert "heal it with: rm " in err
    assert err.count("sumo-dist: ") == 1


def test_a_taken_port_ends_the_run_with_its_reason(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        args = ["--workers", "1", "--listen", endpoint, "--out", tmp_path, *QUICK]
        code, out, err = sumo_dist("run", "spot/move_box", *args)
    assert (code, out) == (3, "")
    assert f"cannot listen on {endpoint}: the port is taken, perhaps by another router" in err
    assert err.count("\n") == 1  # nobody was started who would join those who have the port


def descendants(pid):
    """Processes that a launcher of this pid has started, as /proc knows them."""
    mark = f"SUMO_DIST_PARENT={pid}\0".encode()
    found = []
    for environment in Path("/proc").glob("[0-9]*/environ"):
        try:
            if mark in environment.read_bytes():
                found.append(int(environment.parent.name))
        except OSError:
            continue
    return found


def until(condition, timeout):
    deadline = time.monotonic() + timeout
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.05)
    return condition()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="needs Linux's /proc")
@pytest.mark.parametrize(("end", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_no_service_outlives_its_launcher(tmp_path, end, code):
    args = ["--workers", "1", "--out", tmp_path, *QUICK, *FREE]
    launcher = start("run", "spot/move_box", *args)
    try:
        while "cost" not in launcher.stderr.readline():  # until the first plan
            assert launcher.poll() is None
        assert len(descendants(launcher.pid)) >= 5
        launcher.send_signal(end)
        assert launcher.wait(20.0) == code
        assert until(lambda: not descendants(launcher.pid), 20.0)
        assert "Traceback" not in launcher.stderr.read()
    finally:
        for pid in descendants(launcher.pid):
            os.kill(pid, signal.SIGKILL)


@pytest.mark.slow
def test_ctrl_c_keeps_what_a_run_in_one_process_has_recorded(tmp_path):
    args = ["--workers", "0", "--out", tmp_path, "--viewer", "none"]
    process = start("run", "spot/move_box", *args)
    assert "cost" in process.stderr.readline()  # the first plan is made
    process.send_signal(signal.SIGINT)
    code, out, _ = finish(process)
    assert code == 130
    assert "not solved: interrupted" in out
    assert json.loads((tmp_path / "summary.json").read_text())["end_reason"] == "interrupted"
    assert len(Recording.load(tmp_path / "run.npz").states) >= 1
