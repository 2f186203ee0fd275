"""A user's task file and what it may need of the files beside it, for hosts that have neither."""

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from sumo_dist.errors import UsageError
from sumo_dist.hosts.remote import Entry
from sumo_dist.model.files import ASSETS, MESHES, MODELS
from sumo_dist.tasks import load_task

TASKS = "tasks"  # in a host's folder
LARGEST = 64_000_000  # of all files together [bytes]
MOST = 5000  # files
_DATA = (".npy", ".npz", ".json", ".toml", ".csv", ".yaml", ".yml")
_TEXTURES = (".png", ".ktx", ".mtl")
TAKEN = (".py", *MODELS, *MESHES, *_TEXTURES, *_DATA)
_LEFT = ("__pycache__", "runs", "build", "node_modules")


@dataclass(frozen=True)
class TaskFiles:
    """Copies of a task file and those beside it.

    Attributes:
        folder: for them, in a host's folder; another content has another one.
        name: of the task file.
        files: by their paths from the task file's folder.
    """

    folder: str
    name: str
    files: dict[str, Entry]


def task_files(source: str) -> TaskFiles | None:
    """Collect what hosts need of a task; None of a task that is installed.

    Args:
        source: as `load_task` takes it; it can be loaded.

    Raises:
        UsageError: its models lie elsewhere, or there is too much beside it.
    """
    if not source.endswith(".py"):
        return None
    path = Path(source).absolute()
    _check_models(path)
    files, size = {}, 0
    for found in _beside(path.parent):
        size += found.stat().st_size
        if size > LARGEST:
            raise _too_much(f"{LARGEST // 1_000_000} MB", path.parent)
        files[found.relative_to(path.parent).as_posix()] = Entry(found.read_bytes())
    digest = hashlib.sha256()
    for name, entry in sorted(files.items()):
        digest.update(f"{name} {len(entry.content)}\n".encode() + entry.content)
    return TaskFiles(f"{TASKS}/{digest.hexdigest()[:16]}", path.name, files)


def _beside(folder: Path) -> list[Path]:
    """Code, models, meshes, textures and data in a folder and below."""
    found = []
    for where, folders, names in os.walk(folder):
        folders[:] = sorted(f for f in folders if not f.startswith(".") and f not in _LEFT)
        found += [Path(where, n) for n in sorted(names) if n.lower().endswith(TAKEN)]
        if len(found) > MOST:
            raise _too_much(f"{MOST} files", folder)
    return [path for path in found if path.is_file()]


def _too_much(what: str, folder: Path) -> UsageError:
    return UsageError(
        f"more than {what} are in {folder} and below, and hosts would get them all: put the task "
        "file and what it needs into a folder of its own"
    )


def _check_models(path: Path) -> None:
    scene = load_task(str(path)).scene
    for thing in (*scene.objects, *scene.fixtures):
        model = Path(os.path.normpath(ASSETS / thing.mjcf))
        if not (model.is_relative_to(path.parent) or model.is_relative_to(ASSETS)):
            raise UsageError(
                f"{path} uses {model}, which other hosts do not have: put it beside the task file"
            )
