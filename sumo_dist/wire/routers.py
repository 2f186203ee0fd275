"""Which routers run on this machine: each has a small file that says where it is.

The process that a router belongs to holds a lock on its file, so a file whose process has died, how
ever it went, is known for what it is. The files are in a folder that only their user can write to.
"""

import fcntl
import json
import os
import re
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from sumo_dist.errors import SumoError
from sumo_dist.wire.session import checked_endpoint, port_of

VARIABLE = "SUMO_DIST_RUNTIME"  # names the only folder of such files, in place of the usual ones

_NAME = re.compile(r"\d{1,5}\.json")
_LONGEST = 10_000  # of a file [bytes]; ours have some hundred
_GLANCE_S = 0.01  # who looks whether a file's process is alive holds its lock for less
_GLANCES = 5


@dataclass(frozen=True)
class LocalRouter:
    """A router on this machine.

    Attributes:
        endpoint: at which this machine reaches it.
        what: it is for, in a few words for people.
        pid: of the process that it belongs to.
    """

    endpoint: str
    what: str
    pid: int

    @property
    def who(self) -> str:
        """What it is for, and whose it is."""
        return f"{self.what}, process {self.pid}" if self.what else f"process {self.pid}"


@contextmanager
def left_note(router: LocalRouter) -> Iterator[bool]:
    """Leave a router's file while it is there.

    Yields:
        False if another process of this user has the port, and nothing was written. Where there is
        no folder to write to, nothing is written either, and it is True: the router is then found
        by its endpoint alone.
    """
    folder = _writable_folder()
    if folder is None:
        yield True
        return
    path = folder / f"{port_of(router.endpoint)}.json"
    try:
        file = _locked(path)
    except BlockingIOError:
        yield False
        return
    except OSError:
        yield True
        return
    try:
        os.ftruncate(file, 0)
        os.write(file, json.dumps(asdict(router)).encode())
        yield True
    finally:
        with suppress(OSError):
            path.unlink()
        os.close(file)


def local_routers() -> list[LocalRouter]:
    """Return the routers of this user whose processes are alive, by endpoint."""
    found = {}
    for folder in filter(_is_ours, _folders()):
        for path in folder.iterdir():
            if _NAME.fullmatch(path.name):
                with suppress(OSError):
                    router = _read(path)
                    if router is not None:
                        found[router.endpoint] = router
    return [found[endpoint] for endpoint in sorted(found)]


def _folders() -> Iterator[Path]:
    """Yield where files may be, the preferred place first.

    A run that is started by cron, say, has no XDG_RUNTIME_DIR and is to be found all the same.
    """
    if alone := os.environ.get(VARIABLE):
        yield Path(alone)
        return
    user = os.getuid()
    if runtime := os.environ.get("XDG_RUNTIME_DIR"):
        yield Path(runtime, "sumo-dist")
    else:
        yield Path(f"/run/user/{user}", "sumo-dist")
    with suppress(FileNotFoundError):  # a container may have no folder that can be written to
        yield Path(tempfile.gettempdir(), f"sumo-dist-{user}")


def _is_ours(folder: Path) -> bool:
    """Whether a folder is one that this user alone can write to."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022


def _writable_folder() -> Path | None:
    for folder in _folders():
        with suppress(OSError):
            folder.mkdir(mode=0o700)
        if _is_ours(folder) and os.access(folder, os.W_OK | os.X_OK):
            return folder
    return None


def _locked(path: Path) -> int:
    """Return the open file at a path, locked.

    Raises:
        BlockingIOError: another process holds it.
    """
    for glance in range(_GLANCES):
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(file), path.lstat()):  # else it was removed meanwhile
                return file
        except BlockingIOError:
            if glance == _GLANCES - 1:
                os.close(file)
                raise
        except FileNotFoundError:
            pass
        os.close(file)
        time.sleep(_GLANCE_S)
    raise BlockingIOError(f"{path} comes and goes")


def _read(path: Path) -> LocalRouter | None:
    """Return the router of a file; None, and the file is removed, if its process has died."""
    file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return _parsed(os.read(file, _LONGEST))
        path.unlink()
        return None
    finally:
        os.close(file)


def _parsed(content: bytes) -> LocalRouter | None:
    """Return what a file says; None if that is not what is written here."""
    try:
        said = json.loads(content)
        endpoint, what, pid = said["endpoint"], said["what"], said["pid"]
        return LocalRouter(checked_endpoint(endpoint), " ".join(str(what)[:200].split()), int(pid))
    except (SumoError, ValueError, TypeError, KeyError, RecursionError):
        return None
