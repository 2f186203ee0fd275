"""Runs sumo-dist on what people bring, holds it to what they may expect, and lists its answers.

`deploy/check tests/cases --answers FILE` writes the list as a table.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from sumo_dist.bench.layout import markdown
from sumo_dist.cli import main

TITLE = """# deploy/check tests/cases --answers FILE

What people bring, by kind, what is asked with it, and the line that answers; long ones are cut."""
ROOT, HOME = Path(__file__).parents[2], os.path.expanduser("~")
COLUMNS = ("kind", "what is brought", "sumo-dist ...", "exit", "answer")


class Case(NamedTuple):
    """One row of the table.

    Attributes:
        kind: of fault, the same text for all cases of the kind.
        brought: what the user has or does.
        command: what was asked, without folders.
        code: exit code.
        answer: the line of the output that answers.
    """

    kind: str
    brought: str
    command: str
    code: int
    answer: str


CASES = pytest.StashKey[list[Case]]()


def pytest_addoption(parser):
    parser.addoption(
        "--answers", type=Path, metavar="FILE", help="write a table of all cases and their answers"
    )


def pytest_configure(config):
    config.stash[CASES] = []


def pytest_sessionfinish(session):
    path = session.config.getoption("--answers", default=None)
    if path is not None:
        rows = [
            [*case[:2], f"`{shorten(case.command)}`", str(case.code), shorten(case.answer)]
            for case in sorted(session.config.stash[CASES])
        ]
        text = f"{TITLE}\n\n{markdown(COLUMNS, rows)}\n"
        path.write_text(text, encoding="utf-8", errors="backslashreplace")


def shorten(text, width=160):
    return text if len(text) <= width else f"{text[: width - 1]}…"


@pytest.fixture
def ask(pytestconfig, capfd, tmp_path):
    """Return a function that runs sumo-dist, checks what it answers and keeps it for the table."""

    def ask(kind, brought, *args, code, says, own_process=False):
        """Run `sumo-dist ARGS`; return all it printed.

        Args:
            kind: of fault, see `Case`.
            brought: what the user has or does, in a few words.
            args: of the command line.
            code: the exit code that is due.
            says: pattern that is found in a line of the output.
            own_process: run in a process of its own: for what ends or takes over a process.
        """
        words = [str(arg) for arg in args]
        if own_process:
            command = [sys.executable, "-P", "-m", "sumo_dist", *words]
            done = subprocess.run(
                command, check=False, capture_output=True, text=True, timeout=120, cwd=tmp_path
            )
            got, printed = done.returncode, done.stdout + done.stderr
        else:
            capfd.readouterr()
            got = main(words)
            printed = "".join(capfd.readouterr())
        answer = next((line for line in printed.splitlines() if re.search(says, line)), None)
        assert answer is not None, f"no line matches {says!r} in:\n{printed}"
        assert "Traceback" not in printed, printed
        assert got == code, printed
        shown = [re.sub(r"\S*/", "", word) if word.startswith("/") else word for word in words]
        for folder in (tmp_path, ROOT):  # which say nothing elsewhere
            answer = answer.replace(f"{folder}/", "").replace(str(folder), ".")
        line = answer.replace(HOME, "~").strip().replace("|", "\\|")
        pytestconfig.stash[CASES].append(Case(kind, brought, " ".join(shown), got, line))
        return printed

    return ask


DRUM = """
<mujoco model="drum">
  <worldbody>
    <body name="drum"><geom type="cylinder" size="0.2 0.3" mass="4"/></body>
  </worldbody>
</mujoco>
"""
IMPORTS = """
import random, sys
from dataclasses import replace
import numpy as np
from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.tasks import load_task, terms
from sumo_dist.tasks.families import Manipuland, move, upright
from sumo_dist.tasks.task import Goal
DRUM = Manipuland("drum", "drum.xml", rest_z=0.3)
CALLS = []
"""


@pytest.fixture
def write_task(tmp_path):
    """Return a function that writes a task file beside the model of a drum."""

    def write_task(returns, code="", model=DRUM):
        """Write a file whose task() returns an expression, after some code; return its path."""
        (tmp_path / "drum.xml").write_text(model)
        path = tmp_path / "mine.py"
        path.write_text(f"{IMPORTS}\n{code}\n\ndef task():\n    return {returns}\n")
        return path

    return write_task
