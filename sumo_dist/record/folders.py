"""Folders of runs: one each, also for those that begin in the same instant."""

from collections.abc import Iterator
from itertools import count
from pathlib import Path

from sumo_dist.errors import UsageError

RECORDING = "run.npz"
_EPISODES = "episode-[0-9]*"


def fresh_folder(path: Path) -> Path:
    """Make a folder that was not there, and return it: `path`, or `path`-2 and so on.

    Raises:
        UsageError: it cannot be made.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for folder in _numbered(path):
            try:
                folder.mkdir()
            except FileExistsError:  # of another run, perhaps one that began just now
                continue
            return folder
    except OSError as error:
        raise UsageError(f"cannot write to {path}: {error.strerror}") from None
    raise AssertionError("there is always a next number")


def _numbered(path: Path) -> Iterator[Path]:
    yield path
    yield from (path.with_name(f"{path.name}-{number}") for number in count(2))


def episode_folder(run: Path, number: int) -> Path:
    """Folder of an episode of a run, counted from 1; the first one has the run's own."""
    return run if number == 1 else run / f"episode-{number}"


def later_episodes(run: Path) -> list[Path]:
    """Folders of a run's second and later episodes, in order."""
    found = [(path.name.removeprefix("episode-"), path) for path in run.glob(_EPISODES)]
    return [path for _, path in sorted((int(n), path) for n, path in found if n.isdecimal())]


def last_episode(run: Path) -> Path:
    """Folder of the last episode of a run: a reset or another task begins a new one."""
    return (later_episodes(run) or [run])[-1]


def newest_runs(runs: Path) -> list[Path]:
    """Folders in a folder of runs that hold a recording, the newest first."""
    found = [
        path for pattern in ("*", f"*/{_EPISODES}") for path in runs.glob(f"{pattern}/{RECORDING}")
    ]
    return [path.parent for path in sorted(found, key=lambda p: p.stat().st_mtime, reverse=True)]
