"""Recordings whose task, object or MuJoCo is not what it was, and replays beside odd files."""

import json
import shutil

import imageio.v2 as imageio
import numpy as np
import pytest

REPLAY = "replay"
ALONE = "subprocesses without -P"
QUICK = (
    *("--workers", "0", "--viewer", "none", "--threads", "1", "--time-limit", "0.2"),
    *("--set", "rollouts=4", "--set", "horizon=0.4"),
)

BIN = """<mujoco><worldbody><body name="bin"><freejoint/>
  <geom name="side" type="cylinder" size="{radius} 0.35" mass="4" rgba="0.9 0.2 0.1 1"/>
  <site name="lid" pos="0 0 0.35"/>
</body></worldbody></mujoco>
"""
TASK = """
from dataclasses import replace
import numpy as np
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import SceneObject
from sumo_dist.tasks import load_task
from sumo_dist.tasks.reset import OnFloor, Reset

def at(x, y):
    return lambda rng: (np.array([x, y]), 0.0)

def task():
    move = load_task("spot/move_box")
    return replace(
        move,
        name="spot/move_bin",
        scene=replace(move.scene, objects=(SceneObject("box", "bin.xml"),)),
        frames={**move.frames, "lid": FrameRef("site", "box/lid")},
        reset=Reset(at(-0.5, 0.0), (OnFloor("box", at(1.0, 0.4), 0.35),)),
        trails=("gripper", "lid"),
    )
"""


@pytest.fixture
def bring(tmp_path):
    """Write a task of one's own beside its object; return its file."""
    (tmp_path / "bin.xml").write_text(BIN.format(radius=0.2))
    (tmp_path / "move_bin.py").write_text(TASK)
    return tmp_path / "move_bin.py"


@pytest.fixture
def run(ask, bring, tmp_path):
    """Record the task; return the folder."""
    folder = tmp_path / "run"
    ask(
        *(REPLAY, "a task of one's own", "run", bring, *QUICK, "--out", folder),
        code=1,
        says="spot/move_bin seed 0: not solved: timeout",
    )
    return folder


def changed(folder, **parts):
    """Change parts of a recording; None leaves one out."""
    with np.load(folder / "run.npz") as file:
        kept = {**dict(file), **parts}
    np.savez(folder / "run.npz", **{k: v for k, v in kept.items() if v is not None})


def config(folder, **changes):
    with np.load(folder / "run.npz") as file:
        return np.asanyarray(json.dumps({**json.loads(str(file["config"])), **changes}))


def film(folder):
    return imageio.imread(folder / "film.jpg").astype(float)


CHANGES = {
    "its object has another size since": lambda at: at.with_name("bin.xml").write_text(
        BIN.format(radius=0.5)
    ),
    "its object's file is gone": lambda at: at.with_name("bin.xml").unlink(),
    "its task's file is gone": lambda at: at.unlink(),
    "its task raises now": lambda at: at.write_text("raise RuntimeError('not any more')"),
    "its task moves another thing now": lambda at: at.write_text(
        "from sumo_dist.tasks import load_task\ndef task(): return load_task('spot/upright_tire')"
    ),
}


def test_a_film_shows_the_world_that_was(ask, run, bring, tmp_path):
    shown = ("replay", run, "--render", tmp_path / "film.jpg")
    ask(REPLAY, "nothing has changed", *shown, code=0, says="wrote .*film.jpg")
    before = film(tmp_path)
    (tmp_path / "film.jpg").unlink()
    CHANGES["its object has another size since"](bring)
    ask(REPLAY, "its object has another size since", *shown, code=0, says="wrote .*film.jpg")
    assert np.abs(film(tmp_path) - before).mean() < 1.0  # of 255


@pytest.mark.parametrize("brought", CHANGES)
def test_a_repetition_says_that_the_task_is_another(ask, run, bring, brought):
    ask(REPLAY, "nothing has changed", "replay", run, "--verify", code=0, says="to the last bit")
    CHANGES[brought](bring)
    says = r"has changed since this run: its hash was \w+|is not here as it was: .*"
    ask(REPLAY, brought, "replay", run, "--verify", code=2, says=says)


def test_recordings_without_a_model_need_their_task(ask, run, bring, tmp_path):
    """Such as those of older versions."""
    changed(run, model=None, format=np.array(2))
    shown = ("replay", run, "--render", tmp_path / "film.jpg")
    old = "an old recording, its task as it was"
    ask(REPLAY, old, *shown, code=0, says="wrote .*film.jpg")
    CHANGES["its object has another size since"](bring)
    old = "an old recording, its object has changed"
    ask(REPLAY, old, *shown, code=2, says="has changed since this run: its hash was")


def test_a_recording_of_another_mujoco_or_with_a_broken_model_is_one_line(ask, run, tmp_path):
    shown = ("replay", run, "--render", tmp_path / "film.jpg")
    newer = {"versions": {"mujoco": "9.1.0", "sumo-dist": "0.1.0"}}
    changed(run, config=config(run, **newer))
    says = "made with MuJoCo 9.1.0, which alone can read its model; here it is .*pip install"
    ask(REPLAY, "a recording of another MuJoCo", *shown, code=2, says=says)


@pytest.mark.parametrize("part", ["cut short", "of zeros"])
def test_a_model_that_is_none_is_one_line(ask, run, tmp_path, part):
    with np.load(run / "run.npz") as file:
        model = file["model"]
    changed(run, model=model[: len(model) // 2] if part == "cut short" else model * 0)
    shown = ("replay", run, "--render", tmp_path / "film.jpg")
    says = "this recording's model cannot be read"
    ask(REPLAY, f"a recording with a model {part}", *shown, code=2, says=says)


def test_without_an_argument_the_newest_run_is_taken(ask, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    none = ("replay", "--verify")
    ask(REPLAY, "no run at all", *none, code=2, says="no run below .*runs: name the folder of one")
    (tmp_path / "runs").mkdir()
    shutil.copytree(run, tmp_path / "runs" / "a")
    shutil.move(run, tmp_path / "runs" / "b")
    (tmp_path / "runs" / "a" / "run.npz").touch()
    ask(REPLAY, "no folder named", *none, code=0, says=r"the newest run: runs/a$")
    file = tmp_path / "runs" / "b" / "run.npz"
    ask(REPLAY, "the recording itself", "replay", file, "--verify", code=0, says="to the last bit")


@pytest.mark.slow
def test_a_film_beside_files_named_like_modules(ask, run, tmp_path):
    for name in ("numpy", "imageio", "logging"):
        (tmp_path / f"{name}.py").write_text(f"raise RuntimeError('my {name}.py')")
    brought = "numpy.py, imageio.py, logging.py in the working directory"
    ask(
        *(ALONE, brought, "replay", run, "--render", "film.jpg"),
        code=0,
        says="wrote film.jpg",
        own_process=True,
    )
