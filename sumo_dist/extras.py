"""Optional parts of the installation, and whether what they need is there."""

import re
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version

from sumo_dist.errors import SumoError


def need(extra: str, what: str) -> None:
    """Make sure that an extra is complete.

    Args:
        extra: its name, such as "view".
        what: what needs it, for the error.

    Raises:
        SumoError: a package is not installed, or is another version than those that work.
    """
    if reasons := lacking(extra):
        raise SumoError(f"{what} needs {', '.join(reasons)}: pip install 'sumo-dist[{extra}]'")


def lacking(extra: str) -> list[str]:
    """Say of each package of an extra that is missing or out of its bounds what is wrong."""
    reasons = []
    for name, bounds in required(extra):
        try:
            found = version(name)
        except PackageNotFoundError:
            reasons.append(f"{name}, which is not installed")
            continue
        if not all(satisfies(found, bound) for bound in bounds):
            reasons.append(f"{name} {','.join(bounds)}, not {found}")
    return reasons


def required(extra: str = "") -> Iterator[tuple[str, list[str]]]:
    """Yield name and bounds of each package that an extra needs, or that is always needed."""
    for requirement in requires("sumo-dist") or []:
        package, _, marker = requirement.partition(";")
        wanted = re.search(r"""extra\s*==\s*["']([\w-]+)""", marker)
        if (wanted[1] if wanted else "") != extra:
            continue
        match = re.match(r"([\w.-]+)\s*\(?([^;)]*)", package.strip())
        if match is None or match[1] == "sumo-dist":  # an extra of several others
            continue
        yield match[1], [bound.strip() for bound in match[2].split(",") if bound.strip()]


def satisfies(found: str, bound: str) -> bool:
    """Whether a version keeps a bound such as ">=4.0" or "<4.1"."""
    operator, limit = re.match(r"(>=|<|==)\s*(.+)", bound).groups()  # pyright: ignore
    ours, theirs = (
        tuple(int(part) for part in re.findall(r"\d+", text.partition("+")[0])[:3])
        for text in (found, limit)
    )
    if operator == "==":
        return ours[: len(theirs)] == theirs
    return ours >= theirs if operator == ">=" else ours < theirs
