"""Tasks from files and from installed packages, good and bad."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from sumo_dist.costs.view import View
from sumo_dist.errors import UsageError
from sumo_dist.tasks import load_task, task_names, task_source
from sumo_dist.tasks.task import Goal

BARREL = """
<mujoco model="barrel">
  <worldbody>
    <body name="barrel"><geom type="cylinder" size="0.25 0.35" mass="6"/></body>
  </worldbody>
</mujoco>
"""
GOOD = """
from sumo_dist.tasks.spot.families import Manipuland, move

def task():
    return move(Manipuland("barrel", "barrel.xml", rest_z=0.35))
"""
UNPAID = """
from dataclasses import replace
from sumo_dist.tasks import load_task

def task():
    return replace(load_task("spot/move_box"), cost=())
"""


def write(folder: Path, text: str, name: str = "mine.py") -> str:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "barrel.xml").write_text(BARREL)
    (folder / name).write_text(text)
    return str(folder / name)


def test_a_file_is_a_task_with_its_models_beside_it(tmp_path):
    path = write(tmp_path, GOOD)
    task = load_task(path)
    assert task.name == "spot/move_barrel"
    assert task.source == path
    assert task.scene.objects[0].mjcf == str(tmp_path / "barrel.xml")


def test_a_relative_path_means_the_same_from_elsewhere(tmp_path, monkeypatch):
    write(tmp_path / "here", GOOD)
    monkeypatch.chdir(tmp_path)
    assert load_task("here/mine.py").source == str(tmp_path / "here" / "mine.py")
    assert task_source("here/mine.py") == str(tmp_path / "here" / "mine.py")
    assert task_source("spot/move_box") == "spot/move_box"


def test_models_that_are_not_beside_the_file_come_from_the_assets(tmp_path):
    task = load_task(write(tmp_path, GOOD.replace("barrel.xml", "objects/box.xml")))
    assert task.scene.objects[0].mjcf == "objects/box.xml"


def test_a_changed_file_is_another_task_in_the_same_process(tmp_path):
    path = write(tmp_path, GOOD)
    assert load_task(path).goal == Goal("object", 0.35)
    write(tmp_path, GOOD.replace("0.35", "0.75"))
    assert load_task(path).goal == Goal("object", 0.75)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("x = 1\n", r"defines no function task\(\)"),
        ("task = 3\n", r"defines no function task\(\)"),
        ("def task():\n    return 7\n", r"task\(\) returned int, must return a Task"),
        ("def task(:\n", "line 1: SyntaxError"),
        ("import nowhere_to_be_found\n", r"mine.py, line 1: ModuleNotFoundError: .*nowhere"),
        ("def task():\n    return 1 / 0\n", "mine.py, line 2: ZeroDivisionError"),
        ("def task(name):\n    return name\n", "TypeError"),
        (GOOD.replace("rest_z", "rests"), "TypeError: .*'rests'"),
        (UNPAID, "cost terms need distinct names"),
    ],
)
def test_a_bad_file_is_one_line_that_says_where(tmp_path, text, reason):
    path = write(tmp_path, text)
    with pytest.raises(UsageError, match=reason) as caught:
        load_task(path)
    assert str(caught.value).startswith(f"task file {path}")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(UsageError, match=r"nothing.py does not exist on this host"):
        load_task(str(tmp_path / "nothing.py"))


HELPED = """
from helper import HEIGHT
from sumo_dist.tasks.spot.families import Manipuland, move

def task():
    return move(Manipuland("barrel", "barrel.xml", rest_z=HEIGHT))
"""


def helped(folder, height, text=HELPED):
    path = write(folder, text)
    (folder / "helper.py").write_text(f"HEIGHT = {height}\n")
    return path


def test_a_file_may_import_a_module_beside_it(tmp_path):
    assert load_task(helped(tmp_path, 0.4)).goal == Goal("object", 0.4)
    assert str(tmp_path) not in sys.path


def test_modules_of_one_name_in_two_folders_do_not_mix(tmp_path):
    one, two = helped(tmp_path / "one", 0.4), helped(tmp_path / "two", 0.5)
    heights = [load_task(path).goal.z for path in (one, two, one, two)]
    assert heights == [0.4, 0.5, 0.4, 0.5]


def test_a_changed_module_is_read_again(tmp_path):
    path = helped(tmp_path, 0.4)
    assert load_task(path).goal.z == 0.4
    helped(tmp_path, 0.75)
    assert load_task(path).goal.z == 0.75


def test_a_module_may_be_imported_late(tmp_path):
    """Inside task(), which is called after the file was read."""
    late = HELPED.replace("from helper import HEIGHT\n", "").replace(
        "def task():\n", "def task():\n    from helper import HEIGHT\n"
    )
    assert load_task(helped(tmp_path, 0.6, late)).goal.z == 0.6


def test_a_task_goes_on_with_the_module_it_was_loaded_with(tmp_path):
    """Two tasks live in one worker: what one has imported is not what another finds."""
    term = """
import helper
from dataclasses import replace
import numpy as np
from sumo_dist.costs.terms import CostTerm
from sumo_dist.tasks import load_task

def height(r):
    return np.full(r.actions.shape[:2], helper.HEIGHT)

def task():
    return replace(load_task("spot/move_box"), cost=(CostTerm("height", height, 1.0),))
"""
    one = load_task(helped(tmp_path / "one", 0.4, term))
    two = load_task(helped(tmp_path / "two", 0.5, term))
    view = View({}, np.zeros((1, 2, 9)))
    assert [task.cost[0].evaluate(view).tolist() for task in (one, two, one)] == [
        [0.4],
        [0.5],
        [0.4],
    ]


def test_a_module_beside_does_not_hide_an_installed_one(tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "colorsys", raising=False)  # as if nobody had it yet
    (tmp_path / "colorsys.py").write_text("raise RuntimeError('not this one')\n")
    assert load_task(write(tmp_path, "import colorsys\n" + GOOD)).goal.z == 0.35


def test_a_fault_in_a_module_beside_is_named_there(tmp_path):
    path = write(tmp_path, HELPED)
    (tmp_path / "helper.py").write_text("\n\nHEIGHT = 1 / 0\n")
    with pytest.raises(UsageError, match=r"task file .*mine.py: helper.py, line 3: ZeroDivision"):
        load_task(path)


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return a function that installs a package of one module and its entry points."""

    def install(text: str, *points: str) -> None:
        write(tmp_path / "barrels", text, "tasks.py")
        (tmp_path / "barrels" / "__init__.py").touch()
        info = tmp_path / "barrels-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: barrels\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("\n".join(["[sumo_dist.tasks]", *points, ""]))
        importlib.invalidate_caches()

    monkeypatch.syspath_prepend(str(tmp_path))
    yield install
    for name in [name for name in sys.modules if name.partition(".")[0] == "barrels"]:
        del sys.modules[name]


def test_an_installed_package_adds_its_task(package, tmp_path):
    package(GOOD, "spot/move_barrel = barrels.tasks:task")
    assert "spot/move_barrel" in task_names()
    task = load_task("spot/move_barrel")
    assert (task.name, task.source) == ("spot/move_barrel", "spot/move_barrel")
    assert task.scene.objects[0].mjcf == str(tmp_path / "barrels" / "barrel.xml")


@pytest.mark.parametrize(
    ("point", "reason"),
    [
        ("spot/other = barrels.tasks:task", "calls itself 'spot/move_barrel'"),
        ("spot/other = barrels.tasks:tusk", "AttributeError"),
        ("spot/other = barrels.nowhere:task", "ModuleNotFoundError"),
        ("spot/move_box = barrels.tasks:task", "defined more than once"),
    ],
)
def test_a_package_at_fault_is_named(package, point, reason):
    package(GOOD, point)
    with pytest.raises(UsageError, match=reason):
        load_task(point.partition(" ")[0])
