"""Code on the pages: commands are those there are, Python runs, data parses."""

import json
import re
import shlex
import subprocess
import tomllib
from dataclasses import fields
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import pytest
import tyro

from sumo_dist.cli import COMMANDS, GROUPS, HELP
from sumo_dist.errors import SumoError

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    path
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"))
    if path.name != "CHANGELOG.md"
)
DATA = {"toml": tomllib.loads, "json": json.loads, "xml": ElementTree.fromstring}
TEXTS = ("", "text", "markdown", "{eval-rst}")  # output, drawings, what only the site reads
SHOWN_ELSEWHERE = {  # their Python is run there
    "README.md": "tests/project/test_library.py",
    "docs/library.md": "tests/project/test_library.py",
    "docs/guides/learning.md": "tests/planner/test_value.py",
    "docs/tutorials/new-object.md": "tests/tasks/test_tutorial.py",
}
OF_THEIR_COMMIT = ROOT / "docs" / "results"  # what was typed then need not be valid today


class Block(NamedTuple):
    """A fenced block."""

    page: str
    line: int
    language: str
    text: str


def blocks_of(page: str, text: str) -> list[Block]:
    found = re.finditer(r"^( *)```(\S*)\n(.*?)^\1```$", text, flags=re.DOTALL | re.MULTILINE)
    return [
        Block(
            page,
            text[: match.start()].count("\n") + 1,
            match[2],
            re.sub(rf"^{match[1]}", "", match[3], flags=re.MULTILINE),
        )
        for match in found
    ]


BLOCKS = [b for p in PAGES for b in blocks_of(str(p.relative_to(ROOT)), p.read_text("utf-8"))]
SHELL = [block for block in BLOCKS if block.language == "sh"]


def name_of(block: Block) -> str:
    return f"{block.page}:{block.line}"


def commands_in(shell: str) -> list[list[str]]:
    """Calls of our command line in a piece of shell, as its arguments."""
    found = []
    for name, first in re.findall(r"\bfor (\w+) in ([\w.-]+)", shell):
        shell = re.sub(rf"\$\{{?{name}\b\}}?", first, shell)
    for line in re.sub(r"\\\n\s*", " ", shell).splitlines():
        words = shlex.shlex(line, posix=True, punctuation_chars=True)
        words.whitespace_split = True
        for call in calls_in(list(words)):
            program, *args = call
            if program == "deploy/launch":
                args = ["run", *args]
            elif Path(program).name != "sumo-dist":
                continue
            found.append(args)
    return found


def calls_in(words: list[str]) -> list[list[str]]:
    """Split a line of shell into the programs that it starts, each with its arguments."""
    calls: list[list[str]] = [[]]
    for word in words:
        if set(word) <= set(";&|()<>"):
            calls.append([])
        elif calls[-1] or word not in ("do", "then", "else", "if", "exec", "!"):
            calls[-1].append(word)
    return [call for call in calls if call]


def switches(command: str) -> set[str]:
    """How the options of a command are spelled."""
    names = [field.name.replace("_", "-") for field in fields(options_of(command))]
    return {f"--{no}{name}" for name in names for no in ("", "no-")}


@cache
def options_of(command: str) -> type:
    found = COMMANDS[command]
    return getattr(import_module(found.module), found.options)


def trouble(words: list[str]) -> str:
    """What the command line has against some arguments; "" if nothing."""
    if words[0] in (*HELP, "--version"):
        return ""
    name = " ".join(words[:2]) if words[0] in GROUPS else words[0]
    if words[0] in GROUPS and words[1:] in ([], ["--help"]):
        return ""
    if name not in COMMANDS:
        return f"no command {name!r}"
    rest = words[len(name.split()) :]
    if rest == ["--help"]:
        return ""
    try:
        tyro.cli(options_of(name), args=rest, console_outputs=False)
    except SystemExit:
        return f"not valid: {shlex.join(words)}"
    except SumoError as error:
        return str(error)
    return ""


def test_every_block_is_of_a_language_that_is_looked_at():
    assert len(BLOCKS) > 50
    known = {"sh", "python", *DATA, *TEXTS}
    assert [name_of(block) for block in BLOCKS if block.language not in known] == []


@pytest.mark.parametrize("block", SHELL, ids=name_of)
def test_shell_is_sound_and_its_commands_are_ours(block):
    done = subprocess.run(
        ["bash", "-n"], input=block.text, text=True, capture_output=True, check=False
    )
    assert done.stderr == ""
    for script in re.findall(r"^(deploy/[\w/-]+)", block.text, flags=re.MULTILINE):
        assert (ROOT / script).stat().st_mode & 0o111 or script.endswith("/"), script
    if not (ROOT / block.page).is_relative_to(OF_THEIR_COMMIT):
        assert [told for words in commands_in(block.text) if (told := trouble(words))] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_within_sentences_are_ours(page):
    """As far as they say which: names, and options by their names."""
    if page.is_relative_to(OF_THEIR_COMMIT) or "decisions" in page.parts:
        return
    prose = re.sub(r"^ *```.*?^ *```$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    for span in re.findall(r"`sumo-dist\s+([^`]+)`", prose):
        words = [word.strip(",;:.") for word in span.split()]
        if words[0] in (*HELP, "COMMAND", "--version"):
            continue
        if words[0] in GROUPS and words[1:] in ([], ["--help"]):
            continue
        name = " ".join(words[:2]) if words[0] in GROUPS else words[0]
        assert name in COMMANDS, span
        asked = {word.partition("=")[0] for word in words if word.startswith("--")}
        assert asked <= {"--help", *switches(name)}, span


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language in DATA], ids=name_of)
def test_data_parses(block):
    assert DATA[block.language](block.text) is not None


def test_all_python_is_run_elsewhere():
    pages = {block.page for block in BLOCKS if block.language == "python"}
    assert pages <= {*SHOWN_ELSEWHERE}
    for page, test in SHOWN_ELSEWHERE.items():
        assert Path(page).name in (ROOT / test).read_text("utf-8")


@pytest.mark.parametrize(
    ("line", "valid"),
    [
        ("run spot/move_box --seed 1", True),
        ("run spot/move_box --sead 1", False),
        ("run spot/move_box --seed one", False),
        ("runn spot/move_box", False),
        ("keys init", True),
        ("keys begin", False),
        ("bench", True),
        ("help", True),
    ],
)
def test_what_is_not_valid_is_noticed(line, valid):
    assert (trouble(shlex.split(line)) == "") == valid


def test_commands_are_found_wherever_they_stand():
    shell = """
source .venv/bin/activate     # sumo-dist in a comment
deploy/launch spot/move_box --viewer none
for task in box_push b; do
  sumo-dist run g1/$task --workers 0   # each
done
sumo-dist bench compare one two | tail; if sumo-dist help; then echo 'sumo-dist said'; fi
.venv/bin/sumo-dist replay runs/one \\
    --repeat
"""
    assert [" ".join(words) for words in commands_in(shell)] == [
        "run spot/move_box --viewer none",
        "run g1/box_push --workers 0",
        "bench compare one two",
        "help",
        "replay runs/one --repeat",
    ]
