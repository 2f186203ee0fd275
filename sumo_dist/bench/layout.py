"""What the benches print: Markdown tables below a heading, and notices while they run."""

import sys
from collections.abc import Mapping, Sequence

VERSIONS = ("sumo_dist", "mujoco", "python")


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out a Markdown table that also reads well as it is."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = [head, ["-" * width for width in widths], *rows]
    return "\n".join(
        f"| {' | '.join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))} |"
        for line in lines
    )


def heading(command: str, about: Mapping[str, str]) -> str:
    """Say which command made the tables below, of which code, on what machine."""
    versions = ", ".join(f"{key.replace('_', '-')} {about[key]}" for key in VERSIONS)
    machine = f"{about['machine']}, load average {about['load']} at the start"
    return f"# sumo-dist {command}\n\n{versions}; {machine}."


def say(line: str) -> None:
    """Tell whoever waits."""
    print(line, file=sys.stderr, flush=True)
