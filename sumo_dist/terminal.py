"""Saying something at a terminal, or into a pipe, whose reader may go away at any time."""

import os
import sys
from typing import TextIO


def say(line: str, stream: TextIO | None = None) -> None:
    """Write a line, to stderr by default; where nobody reads any more, it and all others are lost.

    A run is worth more than what is said of it, so it goes on.
    """
    stream = stream or sys.stderr
    if stream is None:  # a process that was started without
        return
    try:
        print(line, file=stream, flush=True)
    except OSError:
        # What the stream still holds is written when Python ends, and would fail again.
        with open(os.devnull, "w", encoding="utf-8") as nowhere:
            os.dup2(nowhere.fileno(), stream.fileno())
