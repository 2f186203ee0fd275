"""Folders of runs: one each, also for those that begin in the same instant."""

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from sumo_dist.errors import UsageError

RUNS = Path("runs")  # where runs are written to that are given no folder
RECORDING = "run.npz"
SERVICES_LOG = "services.log"  # of a run on several hosts
_WRITTEN = (RECORDING, "summary.json", "run.rrd", SERVICES_LOG)
_EPISODES = "episode-[0-9]*"


@contextmanager
def run_folder(given: Path | None, default: Path) -> Iterator[Path]:
    """Have a folder that no other run writes to; a new one in which nothing was written is removed.

    Args:
        given: by the user; what an earlier run has left there is removed.
        default: where none is given; it is new, and has a number after its name if need be.

    Raises:
        UsageError: it cannot be made, or another run writes to it.
    """
    try:
        path = fresh_folder(default) if given is None else given
        path.mkdir(parents=True, exist_ok=True)
        lock = _locked(path)
        if given is not None:
            _empty(path)
    except OSError as error:
        raise UsageError(f"cannot write to {given or default}: {error.strerror}") from None
    try:
        yield path
    finally:
        if given is None:
            with suppress(OSError):  # it is not empty
                path.rmdir()
        if lock is not None:
            os.close(lock)


def fresh_folder(path: Path) -> Path:
    """Make a folder that was not there, and return it: `path`, or `path`-2 and so on.

    Raises:
        UsageError: it cannot be made.
    """
    folder, names = path, (path.with_name(f"{path.name}-{number}") for number in count(2))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        while True:
            with suppress(FileExistsError):  # of another run, perhaps one that began just now
                folder.mkdir()
                return folder
            folder = next(names)
    except OSError as error:
        raise UsageError(f"cannot write to {path}: {error.strerror}") from None


def by_hand(episode: str) -> Path:
    """Folder of a run whose services are started one by one, and know each other by its episodes.

    Args:
        episode: its id as a robot gives it, "SESSION.NUMBER".
    """
    return RUNS / f"by-hand-{episode.partition('.')[0]}"


def episode_folder(run: Path, number: int) -> Path:
    """Folder of an episode of a run, counted from 1; the first one has the run's own."""
    return run if number == 1 else run / f"episode-{number}"


def later_episodes(run: Path) -> list[Path]:
    """Folders of a run's second and later episodes, in order."""
    found = [(path.name.removeprefix("episode-"), path) for path in run.glob(_EPISODES)]
    return [path for _, path in sorted((int(n), path) for n, path in found if n.isdecimal())]


def last_episode(run: Path) -> Path:
    """Folder of the last episode of a run: a reset or another task begins a new one."""
    return [run, *later_episodes(run)][-1]


def newest_run(runs: Path) -> Path | None:
    """Folder in a folder of runs, or in one of them, that has the newest recording; None: none."""
    found = [*runs.glob(f"*/{RECORDING}"), *runs.glob(f"*/{_EPISODES}/{RECORDING}")]
    return max(found, key=lambda path: path.stat().st_mtime).parent if found else None


def _locked(folder: Path) -> int | None:
    """Lock a folder for as long as what is returned is open; None where that is not possible.

    Raises:
        UsageError: another run has it.
    """
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(lock)
        raise UsageError(f"another run writes to {folder}: give this one another --out") from None
    except OSError:
        os.close(lock)
        return None
    return lock


def _empty(folder: Path) -> None:
    """Remove what an earlier run has written."""
    for name in _WRITTEN:
        (folder / name).unlink(missing_ok=True)
    for episode in later_episodes(folder):
        shutil.rmtree(episode)
