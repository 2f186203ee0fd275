"""What the checkout itself promises: links, paths, documents that point to what exists."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LINKS = ("assets", "policies", "services", "tasks")


def tracked_files() -> list[Path]:
    """Files that git tracks and that are there."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    command = ["git", "-C", str(ROOT), "ls-files", "-z"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    paths = [ROOT / name for name in listed.split("\0") if name]
    return [path for path in paths if path.is_file() and not path.is_symlink()]


def documents() -> list[Path]:
    return [*ROOT.glob("*.md"), *ROOT.glob("*/*.md"), *(ROOT / "docs").rglob("*.md")]


@pytest.mark.parametrize("name", LINKS)
def test_top_level_folders_are_linked_into_the_package(name):
    link = ROOT / "sumo_dist" / name
    assert link.readlink() == Path("..", name)
    assert (link / "__init__.py").is_file() or name == "assets"


def test_no_tracked_file_names_a_place_on_somebodys_machine():
    machine = re.compile(rb"(?<![\w.])/(?:home|Users|root|work|farm|tmp/venv)/")
    named = [str(path) for path in tracked_files() if machine.search(path.read_bytes())]
    assert not named


def test_no_tracked_file_is_large():
    assert not [str(path) for path in tracked_files() if path.stat().st_size > 1_000_000]


@pytest.mark.parametrize("document", documents(), ids=lambda path: str(path.relative_to(ROOT)))
def test_links_between_documents_resolve(document):
    text = re.sub(r"```.*?```", "", document.read_text("utf-8"), flags=re.DOTALL)
    targets = re.findall(r"\]\((?!https?:|mailto:|#)([^)#\s]+)", text)
    assert not [target for target in targets if not (document.parent / target).exists()]


@pytest.mark.parametrize("document", ["README.md", "CONTRIBUTING.md"])
def test_scripts_that_documents_name_can_be_run(document):
    named = set(re.findall(r"(?<![\w/])(?:deploy|\.ci)/\w+", (ROOT / document).read_text("utf-8")))
    assert named
    assert not [name for name in named if not (ROOT / name).stat().st_mode & 0o111]


@pytest.mark.parametrize(
    "record", sorted((ROOT / "docs" / "decisions").glob("0*.md")), ids=lambda path: path.stem
)
def test_decision_records_have_their_form(record):
    text = record.read_text("utf-8")
    assert text.startswith(f"# {record.name[:4]}: ")
    parts = [text.find(f"\n**{part}") for part in ("Decision", "Price.", "Instead of")]
    assert parts == sorted(parts) and parts[0] > 0
    assert len(text.splitlines()) <= 70


def test_decision_records_are_numbered_once():
    numbers = [path.name[:4] for path in (ROOT / "docs" / "decisions").glob("0*.md")]
    assert len(numbers) == len(set(numbers)) >= 2
