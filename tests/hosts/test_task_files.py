"""What of a user's task goes to hosts, and how they find it there."""

import pytest

from sumo_dist.errors import UsageError
from sumo_dist.hosts import task_files as module
from sumo_dist.hosts.task_files import task_files
from sumo_dist.tasks import TASK_FILES, load_task

TASK = """
from sumo_dist.tasks.spot.families import Manipuland, move

def task():
    return move(Manipuland("box", "{model}", rest_z=0.35))
"""
BOX = """<mujoco model="box"><worldbody><body name="box"><freejoint/>
<geom type="box" size="0.2 0.2 0.35" mass="6"/></body></worldbody></mujoco>"""


@pytest.fixture
def task(tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "box.xml").write_text(BOX)
    (folder / "bring.py").write_text(TASK.format(model="box.xml"))
    return folder / "bring.py"


def test_an_installed_task_needs_nothing():
    assert task_files("spot/move_box") is None


def test_code_models_and_data_go_and_nothing_else(task):
    beside = ("part/helper.py", "meshes/a.STL", "gains.toml", "wood.png")
    private = ("key.pem", "notes", ".env", ".venv/lib/x.py", "runs/1/run.npz", "__pycache__/a.py")
    for name in (*beside, *private):
        (task.parent / name).parent.mkdir(parents=True, exist_ok=True)
        (task.parent / name).write_text(name)
    found = task_files(str(task))
    assert found.name == "bring.py"
    assert set(found.files) == {"bring.py", "box.xml", *beside}
    assert found.files["part/helper.py"].content == b"part/helper.py"


def test_another_content_has_another_folder(task):
    before = task_files(str(task)).folder
    assert task_files(str(task)).folder == before
    (task.parent / "box.xml").write_text(BOX.replace('"6"', '"7"'))
    assert task_files(str(task)).folder != before


def test_a_model_that_lies_elsewhere_is_refused(task, tmp_path):
    (tmp_path / "box.xml").write_text(BOX)
    task.write_text(TASK.format(model="../box.xml"))
    with pytest.raises(UsageError, match=r"uses .*/box.xml, which other hosts do not have"):
        task_files(str(task))


@pytest.mark.parametrize(("limit", "value"), [("LARGEST", 100), ("MOST", 1)])
def test_a_folder_with_too_much_in_it_is_refused(task, monkeypatch, limit, value):
    monkeypatch.setattr(module, limit, value)
    with pytest.raises(UsageError, match="put the task file and what it needs into a folder of"):
        task_files(str(task))


def test_a_host_takes_its_own_copy(task, tmp_path, monkeypatch):
    found = task_files(str(task))
    for name, entry in found.files.items():
        path = tmp_path / "host" / found.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(entry.content)
    elsewhere = f"/another/host/{found.folder}/{found.name}"
    with pytest.raises(UsageError, match="does not exist on this host"):
        load_task(elsewhere)
    monkeypatch.setenv(TASK_FILES, str(tmp_path / "host" / "tasks"))
    assert load_task(elsewhere).source == str(tmp_path / "host" / found.folder / found.name)
    assert load_task(str(task)).source == str(task)
