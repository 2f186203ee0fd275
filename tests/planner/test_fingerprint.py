import os
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import sumo_dist
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import PLANNING
from sumo_dist.planner import fingerprint as fingerprinting
from sumo_dist.planner.fingerprint import fingerprint
from sumo_dist.planner.problem import Problem
from sumo_dist.robots.spot import spot_actions
from sumo_dist.tasks import load_task

HERE = __name__.partition(".")[0]
LIMIT = 1.0
PRINT_HASH = "from sumo_dist.tasks import load_task\n" + (
    "from sumo_dist.planner.problem import Problem\nfrom sumo_dist.model.scene import PLANNING\n"
    "print(Problem.build(load_task('spot/upright_tire'), PLANNING).hash)"
)


def of(value):
    return fingerprint(value, {HERE})


@dataclass(frozen=True)
class Bound:
    limit: float

    def below(self, x):
        return x < self.limit


def closure(value):
    return lambda x: x + value


def with_default(value):
    def add(x, y=value):
        return x + y

    return add


def scale(x, by):
    return by * x


def under_the_limit(x):
    return (lambda y: y < LIMIT)(x)


def again(n):
    return again(n - 1) if n else 0


@pytest.mark.parametrize(
    "make",
    [
        closure,
        with_default,
        lambda value: partial(scale, by=value),
        lambda value: Bound(value).below,
        Bound,
        lambda value: closure(Bound(value)),
        lambda value: closure(closure(np.array([0.0, value]))),
        lambda value: {"a": [value, (1, 2)]},
        lambda value: slice(0, int(value)),
    ],
)
def test_what_a_value_holds_decides(make):
    assert of(make(1.0)) == of(make(1.0))
    assert of(make(1.0)) != of(make(2.0))


def test_globals_count_also_inside_inner_functions(monkeypatch):
    before = of(under_the_limit)
    monkeypatch.setitem(globals(), "LIMIT", 2.0)
    assert of(under_the_limit) != before


def test_functions_that_are_called_count_with_their_source(tmp_path):
    def built(text):
        (tmp_path / "mine.py").write_text(text)
        names = {"__name__": HERE}
        exec(compile(text, tmp_path / "mine.py", "exec"), names)
        return of(names["cost"])

    text = "def helper(x):\n    return {} * x\n\ndef cost(r):\n    return helper(r)\n"
    assert built(text.format(1)) != built(text.format(2))


def test_recursion_ends():
    assert of(again) == of(again)


def test_dtype_and_shape_of_arrays_count():
    values = [np.zeros(4), np.zeros((2, 2)), np.zeros(4, np.float32), np.zeros(8, np.float32)]
    assert len({of(value) for value in values}) == len(values)


def test_other_packages_count_by_name_only():
    assert of(np.linalg.norm) == of(np.linalg.norm)
    assert of(np.linalg.norm) != of(np.linalg.det)


def test_a_task_has_the_same_hash_in_another_process():
    ours = Problem.build(load_task("spot/upright_tire"), PLANNING).hash
    root = str(Path(sumo_dist.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", PRINT_HASH], cwd=root, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == ours


def test_the_hash_of_a_task_names_goal_frames_and_actions(tmp_path):
    """None of them is in the cost table or in the source of its functions."""
    crate = "from sumo_dist.tasks.spot.families import Manipuland, move\n\ndef task():\n" + (
        '    return move(Manipuland("box", "objects/box.xml", rest_z={}))\n'
    )
    (tmp_path / "a.py").write_text(crate.format(0.254))
    (tmp_path / "b.py").write_text(crate.format(0.3))
    task = load_task(str(tmp_path / "a.py"))
    aimed = {**task.frames, "aim": FrameRef("site", "box/site_object")}
    others = (
        load_task(str(tmp_path / "b.py")),
        replace(task, frames=aimed),
        replace(task, actions=spot_actions(arm=False)),
    )
    hashes = {Problem.build(each, PLANNING).hash for each in (task, *others)}
    assert len(hashes) == 4


HELPER = """
from sumo_dist.costs.terms import norm

FACTOR = {}

def far(r):
    return FACTOR * norm(r.object.pos)
"""
BESIDE = """
{}
from dataclasses import replace
from sumo_dist.costs.terms import CostTerm
from sumo_dist.tasks import load_task

def task():
    box = load_task("spot/move_box")
    return replace(box, cost=(*box.cost, CostTerm("far", {}, 1.0)))
"""
WAYS = {
    "a function by name": ("from mine_helper import far", "far"),
    "an attribute of a module": ("import mine_helper", "lambda r: mine_helper.far(r)"),
    "a value of a module": (
        "import mine_helper",
        "lambda r: mine_helper.FACTOR * r.object.pos[..., 0]",
    ),
    "a module of another name": ("import mine_helper as h", "lambda r: h.far(r)"),
}


def beside(folder, factor, way):
    folder.mkdir(exist_ok=True)
    (folder / "mine_helper.py").write_text(HELPER.format(factor))
    (folder / "mine.py").write_text(BESIDE.format(*WAYS[way]))
    return str(folder / "mine.py")


def hash_of(path):
    return Problem.build(load_task(path), PLANNING).hash


@pytest.mark.parametrize("way", WAYS)
def test_what_a_helper_beside_the_file_says_counts(tmp_path, way):
    first = hash_of(beside(tmp_path, 2.0, way))
    assert hash_of(beside(tmp_path, 2.0, way)) == first
    assert hash_of(beside(tmp_path, 3.0, way)) != first


def test_a_helper_is_the_same_wherever_it_lies(tmp_path):
    """Workers on other hosts have the files elsewhere."""
    way = "a function by name"
    hashes = {hash_of(beside(tmp_path / name, 2.0, way)) for name in ("one", "two")}
    assert len(hashes) == 1


@pytest.mark.parametrize("way", ["a function by name", "an attribute of a module"])
def test_two_fresh_processes_agree_about_a_helper(tmp_path, way):
    path = beside(tmp_path, 2.0, way)
    code = PRINT_HASH.replace("'spot/upright_tire'", repr(path))
    hashes = {
        subprocess.run(
            [sys.executable, "-P", "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        for seed in ("1", "2")
    }
    assert hashes == {hash_of(path)}


def test_a_task_has_the_same_hash_in_a_checkout_and_installed(monkeypatch):
    checkout = Problem.build(load_task("spot/move_box"), PLANNING).hash
    here = str(Path(sumo_dist.__file__).parents[1])
    installed = (*fingerprinting._INSTALLED, here)
    monkeypatch.setattr(fingerprinting, "_INSTALLED", installed)
    assert Problem.build(load_task("spot/move_box"), PLANNING).hash == checkout


def test_a_function_may_refer_to_a_dataclass_whose_fields_have_no_defaults():
    def bounded(x):
        return Bound(x).below(x)

    assert of(bounded) == of(bounded)
    assert of(bounded) != of(scale)
    assert of(Bound) != of(Bound(1.0))
