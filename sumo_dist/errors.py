"""The one error family of the project, and the exit codes it maps to."""

from collections.abc import Iterable


class SumoError(Exception):
    """Root of every error raised on purpose: a fault of the system (exit code 3)."""

    exit_code = 3


class UsageError(SumoError):
    """The user gave something invalid; the message names what is valid (exit code 2)."""

    exit_code = 2


class TaskError(UsageError):
    """A function of a task, or its file, is at fault; the message names it, and file and line.

    Before a run it is wrong usage; a run that is under way ends with it as a fault.
    """


class PolicyError(UsageError):
    """The file of a learned policy is not there, is none, or was made for something else.

    Before a run it is wrong usage; a run that is under way ends with it as a fault.
    """


class Interrupted(SumoError):
    """A service was told to stop while it waited for something."""


class Stopped(SumoError):
    """A person stopped the robot; the message says who and why."""


def text_of(word: str) -> str:
    """Return a word of the command line or a path, if it is text that messages can carry.

    Raises:
        UsageError: it stands for bytes that are not UTF-8.
    """
    shown = word.encode(errors="backslashreplace").decode()
    if shown != word:
        raise UsageError(f"{shown} is not UTF-8 text: rename the file or folder")
    return word


def unknown(kind: str, name: str, valid: Iterable[str]) -> UsageError:
    """Build the error for a name that is not in a set of valid names."""
    return UsageError(f"unknown {kind} {name!r}; valid: {', '.join(sorted(valid)) or '(none)'}")
