"""The file of a campaign: one JSON object a line, which a killed campaign goes on from."""

import fcntl
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Self, TextIO

from sumo_dist.errors import UsageError

PLANNED = "planned"
STANDING = "standing"

# of rows that do not say
USUAL = {"plant": "nominal", "estimator": "truth", "weight": [], "param": []}
_BEGINNING = '{"task": "'  # of every line


class Trial(NamedTuple):
    """What tells the rows of a journal apart.

    Attributes:
        task: its name, or the path of its file.
        seed: decides the start and all noise.
        variant: PLANNED, or STANDING for the control in which the robot only stands.
    """

    task: str
    seed: int
    variant: str = PLANNED

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Self:
        """Return whose row it is."""
        return cls(row["task"], row["seed"], row["variant"])


class Journal:
    """Trials on disk, appended as they end.

    Attributes:
        path: of the file.
        rows: of every trial in the file, by their keys.
    """

    def __init__(
        self,
        path: Path,
        settings: Callable[[Any], Mapping[str, Any]],
        tell: Callable[[str], None],
        key: Callable[[Mapping[str, Any]], Any] = Trial.of,
    ) -> None:
        """Read what is there; a last line that a kill tore is dropped, and `tell` hears of it.

        Args:
            path: the file, made if there is none.
            settings: keys and values that the row of a trial must have.
            tell: takes notices.
            key: tells rows apart, by default whose trial they are.

        Raises:
            UsageError: the file is something else, or was made with other settings, or another
                campaign writes to it.
        """
        self.path, self._key = path, key
        try:
            self._file = _locked(path)
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"cannot use {path} as the file of a campaign: {error}") from None
        whole, newline, torn = text.rpartition("\n")
        if not torn.startswith(_BEGINNING[: len(torn)]):
            raise _not_ours(path)
        self.rows: dict[Any, dict[str, Any]] = {key(row): row for row in _parse(whole, path)}
        for trial, row in self.rows.items():
            _check(row, settings(trial), path)
        if torn:
            tell(f"{path}: dropped a last line that was not written to its end")
            path.write_text(whole + newline, encoding="utf-8")

    def append(self, row: dict[str, Any]) -> None:
        """Write a trial through to the file."""
        self._file.write(json.dumps(row, allow_nan=False) + "\n")
        self._file.flush()
        self.rows[self._key(row)] = row

    def close(self) -> None:
        """Let others write to the file."""
        self._file.close()


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Rows of a journal that somebody may still be writing.

    Raises:
        UsageError: there is no such file, or it is something else.
    """
    try:
        whole, _, _ = path.read_text(encoding="utf-8").rpartition("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"cannot read the trials in {path}: {error}") from None
    return _parse(whole, path)


def _locked(path: Path) -> TextIO:
    """Open a file to append to, locked for as long as it is open."""
    file = path.open("a", encoding="utf-8")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise UsageError(
            f"another campaign writes to {path}: wait for it, or name another file"
        ) from None
    return file


def _parse(whole: str, path: Path) -> list[dict[str, Any]]:
    rows = []
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            row = json.loads(line)
            known = isinstance(row["task"], str) and isinstance(row["seed"], int)
            known = known and row["variant"] in (PLANNED, STANDING)
        except (json.JSONDecodeError, KeyError, TypeError):
            known, row = False, None
        if not known:
            raise _not_ours(path, f", line {number}")
        rows.append(row)
    return rows


def _not_ours(path: Path, place: str = "") -> UsageError:
    return UsageError(f"{path}{place} is no trial of `sumo-dist bench`; name another file")


def _check(row: Mapping[str, Any], wanted: Mapping[str, Any], path: Path) -> None:
    for key, value in wanted.items():
        found = row.get(key, USUAL.get(key))
        if found == value:
            continue
        if isinstance(found, dict) and isinstance(value, dict):
            _check(found, value, path)
        raise UsageError(
            f"{path} was made with other settings: {key} is {found} there and {value} here; "
            "name another file or use the same settings"
        )
