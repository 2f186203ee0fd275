"""The folder of a search: what was asked for, every episode, and what came of it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sumo_dist.bench.campaign.campaign import make_folder
from sumo_dist.bench.results.journal import Journal, read_rows
from sumo_dist.bench.tune.results import Row, Tried, tried
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.terminal import say

REQUEST, EPISODES, REPORT, CURVE, WINNER = (
    *("search.json", "episodes.jsonl", "report.md", "curve.svg", "winner.toml"),
)
HELD_OUT = "held-out"  # folder of the journals of the winner and of the task's own values
OWN = "own"  # name of the journal of the latter


class Folder:
    """Keeps a search on disk; another search's is refused."""

    def __init__(self, path: Path, request: Mapping[str, Any]) -> None:
        """Open a folder, or make it.

        Args:
            path: of the folder.
            request: what was asked for, as JSON has it; what is under "decides" must be the same
                when it goes on.

        Raises:
            UsageError: the folder holds another search, or something else, or somebody else's
                search is writing to it.
        """
        self.path = path
        make_folder(path)
        here = read_request(path) if (path / REQUEST).exists() else None
        if here is None and any(path.iterdir()):
            raise UsageError(f"{path} holds something else than a search; name another folder")
        if here is not None:
            _check_same(here["decides"], json.loads(json.dumps(request["decides"])), path)
        self._journal = Journal(path / EPISODES, lambda _: {}, say, key=_key)
        write(path / REQUEST, json.dumps(request, indent=2) + "\n")

    @property
    def trials(self) -> list[Tried]:
        """What there is so far."""
        return tried(self._journal.rows.values())

    def append(self, row: dict[str, Any]) -> None:
        """Write an episode through to the disk."""
        self._journal.append(row)

    def close(self) -> None:
        """Let others go on with it."""
        self._journal.close()


def _key(row: Mapping[str, Any]) -> tuple[int, int]:
    return row["trial"], row["seed"]


def read_request(path: Path) -> dict[str, Any]:
    """Return what a folder's search was asked for.

    Raises:
        UsageError: the folder holds no search.
    """
    try:
        found = json.loads((path / REQUEST).read_text(encoding="utf-8"))
        if {"decides", "command", "task"} <= set(found):
            return found
    except (OSError, ValueError, TypeError):
        pass
    raise UsageError(f"{path} holds no search of `sumo-dist tune`: no readable {REQUEST} there")


def read_trials(path: Path) -> list[Tried]:
    """Return the trials of a folder whose search somebody may still be running.

    Raises:
        UsageError: the folder holds no search.
    """
    read_request(path)
    rows = read_rows(path / EPISODES)
    if not all({"trial", "values", "state", "cpu_s"} <= set(row) for row in rows):
        raise UsageError(f"{path / EPISODES} is no journal of `sumo-dist tune`")
    return tried(rows)


def winner_name(winner: Tried) -> str:
    """Name of a winner's journal of held-out seeds."""
    return f"trial-{winner.number}"


def read_held_out(path: Path, winner: Tried) -> tuple[list[Row], list[Row]]:
    """Return the rows of the task's own values and of a winner that both have, by seed."""
    files = [path / HELD_OUT / f"{name}.jsonl" for name in (OWN, winner_name(winner))]
    rows = [read_rows(file) if file.exists() else [] for file in files]
    both = sorted(set.intersection(*({row["seed"] for row in of_it} for of_it in rows)))
    own, won = ({row["seed"]: row for row in of_it} for of_it in rows)
    return [own[seed] for seed in both], [won[seed] for seed in both]


def write(path: Path, text: str) -> None:
    """Write a file of the folder, whole or not at all.

    Raises:
        SumoError: the disk does not take it.
    """
    partial = path.with_name(f"{path.name}.part")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        raise SumoError(f"cannot write {path}: {error.strerror}") from None


def _check_same(there: Any, here: Any, path: Path, name: str = "") -> None:
    if isinstance(there, dict) and isinstance(here, dict):
        for key in {**there, **here}:
            _check_same(there.get(key), here.get(key), path, f"{name} {key}".strip())
    elif there != here:
        raise UsageError(
            f"{path} holds another search: {name} is {there} there and {here} here; name another "
            "folder with --out, or use the same settings"
        )
