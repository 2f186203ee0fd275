"""How an episode ended: what kind of end it was, and in words."""

import logging
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Self

from sumo_dist.errors import SumoError

_log = logging.getLogger(__name__)


class End(StrEnum):
    """Kinds of ends."""

    SUCCESS = "success"
    FELL = "fell"
    TIMEOUT = "timeout"
    FAILURE = "failure"  # one that the task names, at the end of its time
    STOPPED = "stopped"  # by a person
    FAULT = "fault"
    INTERRUPTED = "interrupted"
    REPLACED = "replaced"  # by another episode: a reset or another task


_CODES = {End.SUCCESS: 0, End.STOPPED: 3, End.FAULT: 3, End.INTERRUPTED: 130}


@dataclass(frozen=True)
class Ending:
    """How an episode ended.

    Attributes:
        kind: of end.
        detail: which failure or fault, who stopped it and why; "" where the kind says all.
        sat_down: the robot sat down before the end.
        wall_s: wall time of the episode [s].
    """

    kind: End
    detail: str = ""
    sat_down: bool = False
    wall_s: float = 0.0

    @property
    def reason(self) -> str:
        """The end in words, as summary.json has it."""
        words = {
            End.FAILURE: self.detail,
            End.STOPPED: f"stopped by {self.detail}",
            End.FAULT: f"fault: {self.detail}",
            End.REPLACED: f"replaced: {self.detail}",
        }.get(self.kind, self.kind.value)
        return f"{words}, the robot sat down" if self.sat_down else words

    @property
    def success(self) -> bool:
        """Whether the task was achieved."""
        return self.kind is End.SUCCESS

    @property
    def exit_code(self) -> int:
        """0 success, 1 task not achieved, 3 fault or stopped, 130 interrupted."""
        return _CODES.get(self.kind, 1)

    def after(self, wall_s: float) -> Self:
        """Return the same end with the wall time [s] it came after."""
        return replace(self, wall_s=wall_s)


def fault(detail: object) -> Ending:
    """Return the end by a named fault."""
    return Ending(End.FAULT, str(detail))


def unforeseen(error: Exception) -> Ending:
    """Return the end by an error; one that is not ours is logged with where it came from."""
    if isinstance(error, SumoError):
        return fault(error)
    _log.error("this is a fault of the program or of a task's function", exc_info=error)
    return fault(f"{type(error).__name__}: {error}")
