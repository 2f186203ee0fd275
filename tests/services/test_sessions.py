"""Services that are started by hand before any robot is there, and outlive its sessions."""

import time
from dataclasses import replace

import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

OTHERS = ("optimizer", "state-estimator", "local-0", "local-1")

TASK_FILE = """
from dataclasses import replace
import numpy as np
from sumo_dist.costs.terms import CostTerm
from sumo_dist.tasks import load_task

FACTOR = {factor}

def tall(r):
    return FACTOR * np.abs(r.gripper.pos[..., 2])

def task():
    base = load_task("spot/move_box")
    return replace(base, cost=(*base.cost, CostTerm("tall", tall, 30.0)))
"""


@pytest.fixture(autouse=True)
def no_traceback(capfd):
    yield
    assert "Traceback" not in capfd.readouterr().err


def digests(recording):
    return recording.plan_digest, recording.state_digest


def test_they_serve_one_robot_after_another_whatever_its_task(
    run_system, config, tmp_path, read_rrd, eventually
):
    system = run_system(workers=2, starts_robot=False, viewer="none")
    system.kill("tracer")
    system.start_like("tracer", "tracer", linger=True)
    time.sleep(2.0)  # nobody is there to tell them what for
    for number, task in enumerate(("spot/move_box", "spot/upright_tire", "spot/move_box"), 1):
        episode = EpisodeConfig(task, number, config, time_limit=0.6)
        system.start_robot(episode=episode, out=tmp_path / str(number))
        code, summary = system.finish()
        assert (code, summary["end_reason"], summary["plans"]) == (1, "timeout", 12)
        assert digests(run_single(episode, 1)[0]) == digests(system.recording())
    for name in (*OTHERS, "tracer"):
        assert system.processes[name].poll() is None, f"{name} has ended"
    assert system.episodes == 3
    shown = [tmp_path / name for name in ("run.rrd", "run-2.rrd", "run-3.rrd")]

    def states(path):
        try:
            return len(set(read_rrd(path).timed["/world/poses"]["sim_time"]))
        except (RuntimeError, KeyError):  # it is being written, or none is there yet
            return 0

    assert eventually(lambda: shown[-1].exists() and states(shown[-1]) > 20, 120.0)
    system.processes["tracer"].terminate()
    system.processes["tracer"].wait(60.0)
    for path, task in zip(shown, ("move_box", "upright_tire", "move_box"), strict=True):
        rrd = read_rrd(path)
        assert task in str(rrd.static["/about/scene"])
        assert states(path) > 20


def test_a_task_file_that_has_changed_is_taken_up_by_the_next_session(run_system, config, tmp_path):
    """By the optimizer and by the workers, none of which is started again."""
    file = tmp_path / "tall.py"
    file.write_text(TASK_FILE.format(factor=1.0))
    system = run_system(workers=2, starts_robot=False, trust=(tmp_path,))
    seen = []
    for number, factor in enumerate((1.0, -5.0), 1):
        file.write_text(TASK_FILE.format(factor=factor))
        episode = EpisodeConfig(str(file), 1, config, time_limit=0.4)
        system.start_robot(episode=episode, out=tmp_path / str(number))
        code, summary = system.finish()
        assert (code, summary["end_reason"]) == (1, "timeout")
        recording = system.recording()
        assert digests(run_single(episode, 1)[0]) == digests(recording)
        seen.append((system.hash, digests(recording)))
    assert seen[0][0] != seen[1][0]
    assert seen[0][1] != seen[1][1]
    for name in OTHERS:
        assert system.processes[name].poll() is None, f"{name} has ended"


def test_an_optimizer_whose_task_file_differs_from_the_robots_says_so_by_name(
    run_system, config, tmp_path, eventually
):
    """As on another host: the robot has loaded one file, the optimizer finds another."""
    file = tmp_path / "tall.py"
    file.write_text(TASK_FILE.format(factor=1.0))
    system = run_system(workers=1, starts_robot=False, wait=60.0, task=str(file), time_limit=0.4)
    system.kill("optimizer")
    system.start_robot()
    assert eventually(lambda: system.hash, 60.0)  # what the robot has loaded
    theirs = system.hash
    changed = tmp_path / "changed"
    changed.write_text(TASK_FILE.format(factor=2.0))
    changed.replace(file)  # at once: the estimator may be reading it
    system.start_again("optimizer")
    assert eventually(
        lambda: system.said("optimizer", f"the robot's has {theirs}: the task's files differ"), 60.0
    )
    assert system.said("optimizer", f"its {file} has hash ")
    system.interrupt()
    episode = replace(system.options("robot-interface").episode, seed=2)
    system.start_robot(episode=episode, out=tmp_path / "2")  # it has the file of now as well
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
