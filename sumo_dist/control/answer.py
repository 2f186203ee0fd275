"""What came of a command."""

from typing import NamedTuple


class Answer(NamedTuple):
    """What the page is told of a command that it gave.

    Attributes:
        refusal: why it was not carried out; "" if it was.
        tick: at which it was; what was asked of that tick's plan, and later, is as commanded.
    """

    refusal: str = ""
    tick: int = 0
