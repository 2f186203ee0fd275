"""The file of a campaign: one JSON object a line, which a killed campaign goes on from."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from sumo_dist.errors import UsageError

Trial = tuple[str, int]  # task and seed


class Journal:
    """Trials on disk, appended as they end.

    Attributes:
        rows: of every trial in the file.
    """

    def __init__(
        self,
        path: Path,
        settings: Mapping[str, Any],
        task_settings: Mapping[str, Mapping[str, Any]],
        tell: Callable[[str], None],
    ) -> None:
        """Read what is there; a last line that a kill tore is dropped, and `tell` hears of it.

        Args:
            path: the file, made on the first append.
            settings: keys and values that all rows must have.
            task_settings: those of each task in turn.
            tell: takes notices.

        Raises:
            UsageError: the file is something else, or was made with other settings.
        """
        self.path = path
        self.rows: dict[Trial, dict[str, Any]] = {}
        whole = _drop_torn_line(path, tell)
        for number, line in enumerate(whole.splitlines(), 1):
            row = _parse(line, f"{path}, line {number}")
            _check(row, {**settings, **task_settings.get(row["task"], {})}, path)
            self.rows[row["task"], row["seed"]] = row

    def append(self, row: dict[str, Any]) -> None:
        """Write a trial through to the file."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row, allow_nan=False) + "\n")
        self.rows[row["task"], row["seed"]] = row


def _drop_torn_line(path: Path, tell: Callable[[str], None]) -> str:
    try:
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        whole, newline, torn = text.rpartition("\n")
        if torn:
            tell(f"{path}: dropped a last line that was not written to its end")
            path.write_text(whole + newline, encoding="utf-8")
        path.touch()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"cannot use {path} as the file of a campaign: {error}") from None
    return whole


def _parse(line: str, where: str) -> dict[str, Any]:
    try:
        row = json.loads(line)
        if isinstance(row["task"], str) and isinstance(row["seed"], int):
            return row
    except (json.JSONDecodeError, KeyError, TypeError):
        pass
    raise UsageError(f"{where} is not a trial of `sumo-dist bench episodes`; name another file")


def _check(row: Mapping[str, Any], wanted: Mapping[str, Any], path: Path) -> None:
    for key, value in wanted.items():
        found = row.get(key)
        if found == value:
            continue
        if isinstance(found, dict) and isinstance(value, dict):
            _check(found, value, path)
        raise UsageError(
            f"{path} was made with other settings: {key} is {found} there and {value} here; "
            "name another file or use the same settings"
        )
