"""All checks of a task, in order, and which of them say nothing without another."""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from sumo_dist.check.costs import finite, sensitive, split
from sumo_dist.check.findings import Finding, examine
from sumo_dist.check.goals import goal
from sumo_dist.check.identity import identity
from sumo_dist.check.model import frames, model
from sumo_dist.check.speed import speed
from sumo_dist.check.starts import reset, rest, start, unsolved
from sumo_dist.check.subject import Subject


class Check(NamedTuple):
    """One check.

    Attributes:
        look: makes it.
        needs: names of the checks without which it would only repeat what is wrong.
    """

    look: Callable[[Subject], Finding]
    needs: tuple[str, ...] = ()


_WORLD = ("model", "frames", "reset")
CHECKS: Mapping[str, Check] = {
    "model": Check(model),
    "frames": Check(frames, ("model",)),
    "identity": Check(identity, ("model", "frames")),
    "reset": Check(reset, ("model", "frames")),
    "start": Check(start, _WORLD),
    "rest": Check(rest, _WORLD),
    "unsolved": Check(unsolved, _WORLD),
    "goal": Check(goal, (*_WORLD, "rest")),
    "finite": Check(finite, _WORLD),
    "sensitive": Check(sensitive, (*_WORLD, "finite")),
    "split": Check(split, (*_WORLD, "finite")),
    "speed": Check(speed, (*_WORLD, "finite")),
}


def findings(
    subject: Subject, checks: Mapping[str, Check] = CHECKS
) -> Iterator[tuple[str, Finding]]:
    """Yield what each check found; one cause is said once, what it keeps from being made is "skip".

    Args:
        subject: is examined.
        checks: by name, in order.
    """
    failed: dict[str, str] = {}  # what was found by each check that failed
    for name, check in checks.items():
        if lacking := [other for other in check.needs if other in failed]:
            yield name, Finding("skip", f"needs {lacking[0]}")
            failed[name] = ""
            continue
        finding = examine(lambda check=check: check.look(subject))
        if finding.level == "fail":
            same = [other for other, text in failed.items() if text == finding.text]
            failed[name] = finding.text
            finding = Finding("skip", f"as {same[0]}") if same else finding
        yield name, finding
