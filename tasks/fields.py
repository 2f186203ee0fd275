"""What the fields of a task may be; each check raises a UsageError that names the field."""

from collections.abc import Mapping, Sequence
from typing import Any

from sumo_dist.costs.fields import checked_name, checked_number
from sumo_dist.costs.terms import CostTerm
from sumo_dist.errors import UsageError, unknown
from sumo_dist.model.frames import FrameRef

TAKEN = ("actions", "p", "joints")  # a view has these besides its frames
KINDS = ("site", "body")


def check_terms(what: str, cost: Any) -> None:
    """Check that a task's cost is made of terms that have names of their own."""
    if not isinstance(cost, Sequence) or not all(isinstance(term, CostTerm) for term in cost):
        raise UsageError(f"{what}: cost must be a tuple of CostTerm, got {cost!r:.80}")
    names = [term.name for term in cost]
    if not names or len(set(names)) != len(names):
        raise UsageError(f"{what}: cost terms need distinct names, got {names}")


def check_frames(what: str, frames: Any) -> None:
    """Check that frames are references by names that a view can have."""
    if not isinstance(frames, Mapping):
        raise UsageError(f"{what}: frames must be a dict, name to FrameRef, got {frames!r:.80}")
    for name, ref in frames.items():
        checked_name(f"{what}: a frame", name)
        if name in TAKEN or name.startswith("_"):
            raise UsageError(f"{what}: a frame cannot be called {name!r}, a view has its own")
        if not isinstance(ref, FrameRef):
            raise UsageError(f"{what}: frame {name!r} must be a FrameRef, got {ref!r}")
        if ref.kind not in KINDS:
            raise unknown(f"kind of frame {name!r}", ref.kind, KINDS)


def check_functions(what: str, reset: Any, success: Any, failure: Any) -> None:
    """Check that what the episode calls can be called."""
    if not isinstance(failure, Mapping):
        raise UsageError(f"{what}: failure must be a dict, name to function, got {failure!r:.80}")
    for name in failure:
        checked_name(f"{what}: a failure", name)
    failures = {f"failure {name!r}": test for name, test in failure.items()}
    for name, function in {"reset": reset, "success": success, **failures}.items():
        if not callable(function):
            raise UsageError(f"{what}: {name} must be a function, got {function!r:.80}")


def check_times(what: str, success_hold: Any, time_limit: Any) -> None:
    """Check that an episode ends, and that success can be held before it does."""
    limit = checked_number(f"{what}: time_limit", time_limit)
    if limit <= 0:
        raise UsageError(f"{what}: time_limit must be above 0 s, got {time_limit!r}")
    hold = checked_number(f"{what}: success_hold", success_hold, 0.0)
    if hold >= limit:
        raise UsageError(f"{what}: success_hold, {hold:g} s, is no shorter than time_limit")
