"""What scripts are offered: documented, quickly imported, and its examples run."""

import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import sumo_dist
from sumo_dist.view.show import Show

ROOT = Path(__file__).parents[2]


def python_blocks(document: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / document).read_text("utf-8"), flags=re.DOTALL)


@pytest.mark.parametrize("document", ["README.md", "docs/library.md"])
def test_the_examples_of_documents_run(document, tmp_path):
    """As one script: later blocks of a page use what earlier ones have made."""
    blocks = python_blocks(document)
    assert blocks
    script = tmp_path / "script.py"
    script.write_text("\n".join(blocks), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-P", script],
        cwd=tmp_path, capture_output=True, text=True, timeout=170, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    if document == "README.md":
        lines = [line for line in blocks[0].splitlines() if line and not line.startswith("import")]
        assert len(lines) <= 10
        assert done.stdout.startswith("timeout 101 states of ")
        assert sumo_dist.Recording.load(tmp_path / "run.npz").ending == "timeout"


def test_the_notebook_runs(tmp_path):
    """Its cells as one script, each one's last line shown as a notebook shows it."""
    notebook = json.loads((ROOT / "docs" / "examples" / "plan_step_show.ipynb").read_text("utf-8"))
    cells = ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
    script = tmp_path / "notebook.py"
    script.write_text(f"CELLS = {cells!r}\n{RUN_CELLS}", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-P", script],
        cwd=tmp_path, capture_output=True, text=True, timeout=170, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "<iframe src=" in done.stdout and "<img src=" in done.stdout
    assert (tmp_path / "plan_step_show.rrd").stat().st_size > 0
    assert not any(cell.get("outputs") for cell in notebook["cells"])


RUN_CELLS = """
import ast
names = {}
for cell in CELLS:
    *before, last = ast.parse(cell).body
    if isinstance(last, ast.Expr):
        exec(compile(ast.Module(before, []), "cell", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
        print(value._repr_html_()[:200] if hasattr(value, "_repr_html_") else value)
    else:
        exec(cell, names)
"""


def test_the_script_of_the_examples_runs(tmp_path):
    script = ROOT / "docs" / "examples" / "plan_step_show.py"
    loop = script.read_text("utf-8").partition("with ")[2].splitlines()
    assert len([line for line in loop if line]) <= 10
    done = subprocess.run(
        [sys.executable, "-P", script, "0.2", "none"],
        cwd=tmp_path, capture_output=True, text=True, timeout=170, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "out of time after 10 ticks\n"), done.stderr
    assert (tmp_path / "plan_step_show.rrd").stat().st_size > 0


def test_the_page_describes_every_name():
    page = (ROOT / "docs" / "library.md").read_text("utf-8")
    for name in sumo_dist._NAMES:
        assert re.search(rf"`{name}[`(]", page), name
    for kind in (sumo_dist.MPC, Show):
        for name, member in inspect.getmembers(kind):
            if not name.startswith("_") and name != "close":
                assert re.search(rf"`{name}[`(]", page), name
                assert inspect.getdoc(member)


def test_the_signatures_on_the_page_are_those_of_the_code():
    page = " ".join((ROOT / "docs" / "library.md").read_text("utf-8").split())
    for function in (sumo_dist.run_episode, sumo_dist.MPC, sumo_dist.show, sumo_dist.film):
        stated = re.search(rf"`{function.__name__}\(([^`]*)\)`", page)
        assert stated is not None
        names = [word.partition("=")[0] for word in stated[1].split(", ") if word != "*"]
        assert names == list(inspect.signature(function).parameters)


def test_type_checkers_see_what_there_is():
    """The imports for type checkers and the table for Python name the same."""
    source = (ROOT / "sumo_dist" / "__init__.py").read_text("utf-8")
    typed = re.findall(r"^    from (\S+) import (\w+) as \2$", source, flags=re.MULTILINE)
    assert {name: home for home, name in typed} == sumo_dist._NAMES


def test_importing_the_package_imports_nothing_else():
    code = (
        "import sys; before = set(sys.modules); import sumo_dist;"
        "print([m for m in sorted(set(sys.modules) - before) if not m.startswith('_')])"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    extra = set(re.findall(r"'([\w.]+)'", done.stdout)) - {"sumo_dist"}
    assert not {
        name for name in extra if name.partition(".")[0] in ("numpy", "mujoco", "sumo_dist")
    }
