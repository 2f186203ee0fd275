"""What a check comes to: a verdict and a line."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from sumo_dist.errors import SumoError


@dataclass(frozen=True)
class Finding:
    """What one check found.

    Attributes:
        level: "warn" where something is slower or missing, "fail" where the main thing cannot be
            done, "skip" where nothing could be found out.
        text: one line.
    """

    level: Literal["ok", "warn", "fail", "skip"]
    text: str


def verdict(good: bool, text: str, reason: str) -> Finding:
    """Return "ok" with a text, or "fail" with a reason."""
    return Finding("ok", text) if good else Finding("fail", reason)


def examine(check: Callable[[], Finding]) -> Finding:
    """Run a check; whatever it trips over is its finding."""
    try:
        return check()
    except SumoError as error:
        return Finding("fail", " ".join(str(error).split()))
    except Exception as error:  # what a broken installation raises is not ours to foresee
        return Finding("fail", f"{type(error).__name__}: {error}")
