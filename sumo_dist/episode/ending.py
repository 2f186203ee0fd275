"""How an episode ended."""

from dataclasses import dataclass

FAULTS = ("interrupted", "fault", "stopped")  # reasons that are not the task's


@dataclass(frozen=True)
class Ending:
    """How a run ended.

    Attributes:
        reason: the referee's verdict or a named fault.
        wall_s: wall time of the episode [s].
    """

    reason: str
    wall_s: float

    @property
    def exit_code(self) -> int:
        """0 success, 1 task not achieved, 3 fault, 130 interrupted."""
        codes = {"success": 0, "interrupted": 130}
        return codes.get(self.reason, 3 if self.reason.startswith(FAULTS) else 1)
