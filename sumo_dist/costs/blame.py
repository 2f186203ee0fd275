"""Calls of a task's own code: whatever goes wrong in it is one line that says what, and where."""

import dis
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np

from sumo_dist.errors import SumoError, TaskError

_OURS = __name__.partition(".")[0]
_INSTALLED = {"site-packages", "dist-packages"}
LONGEST = 2000  # characters of a line: a message on the bus has room for it


@contextmanager
def blamed(what: str, made: str = "") -> Iterator[None]:
    """Call a task's code inside; all that it raises, SystemExit included, becomes a TaskError.

    Ctrl-C passes, but not a KeyboardInterrupt that the code itself raises.

    Args:
        what: names the code in the message, such as "reset".
        made: where it was made, see `caller`, if it should be none of the task's own code.
    """
    try:
        yield
    except TaskError:
        raise
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt) and not _raised_by_code(error):
            raise
        raise fault_of(what, _place(error) or made, _reason(error)) from error


def fault_of(what: str, place: str, reason: str) -> TaskError:
    """Build the error of a piece of a task's code; `place` is "" where nobody knows it."""
    line = " ".join(": ".join(filter(None, (what, place, reason))).split())
    return TaskError(line.encode("utf-8", "replace").decode()[:LONGEST])  # the bus takes UTF-8


def values_of(what: str, function: Callable[[Any], Any], view: Any, made: str = "") -> np.ndarray:
    """Call a residual, View -> numbers (B, T).

    Raises:
        TaskError: it raises, or returns another shape or what is not a number.
    """
    with blamed(what, made):
        values = np.asarray(function(view))
    shape = view.actions.shape[:2]
    if values.shape != shape:
        reason = f"returned shape {values.shape}, must be (rollouts, steps) = {shape}"
    elif values.dtype.kind not in "biuf":
        reason = f"returned {values.dtype}, must be numbers"
    else:
        return values
    raise fault_of(what, defined(function) or made, reason)


def truths_of(what: str, function: Callable[[Any], Any], view: Any) -> np.ndarray:
    """Call a predicate, View -> (B, T) bool.

    Raises:
        TaskError: as of `values_of`; numbers are none of bool.
    """
    values = values_of(what, function, view)
    if values.dtype != bool:
        reason = f"returned {values.dtype}, must be bool"
        raise fault_of(what, defined(function), reason)
    return values


def defined(function: object) -> str:
    """File and line of a function's definition; "" if it is ours or not written in Python."""
    while isinstance(function, partial):
        function = function.func
    module = getattr(function, "__module__", None) or ""
    code = getattr(function, "__code__", None) or getattr(type(function).__call__, "__code__", None)
    if not isinstance(code, CodeType) or _root(module) == _OURS:
        return ""
    return _line(code.co_filename, code.co_firstlineno)


def caller() -> str:
    """File and line of the innermost of the calls under way that is neither ours nor Python's."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None:
        if _is_foreign(frame):
            return _line(frame.f_code.co_filename, frame.f_lineno)
        frame = frame.f_back
    return ""


def _place(error: BaseException) -> str:
    """File and line at which a task's code was when it, or what it called, raised an error."""
    if isinstance(error, SyntaxError) and error.filename and error.filename.endswith(".py"):
        return _line(error.filename, error.lineno or 1)
    steps = [step for step in traceback.walk_tb(error.__traceback__) if _is_foreign(step[0])]
    if not steps:
        return ""
    package = _root_of(steps[0][0])
    own = [step for step in steps if _root_of(step[0]) == package or not _is_installed(step[0])]
    frame, line = own[-1]
    return _line(frame.f_code.co_filename, line)


def _reason(error: BaseException) -> str:
    """Type and message of an error; ours say enough without the type."""
    if isinstance(error, SumoError):
        return str(error)
    try:
        text = error.msg if isinstance(error, SyntaxError) else str(error)
    except Exception:  # it has a text of its own making, and that fails
        text = ""
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _raised_by_code(error: BaseException) -> bool:
    """Whether an error came of a `raise` that is not ours: a signal may come anywhere.

    The handler of `signals.interruptible` is ours, and the last that the traceback names.
    """
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None or _root_of(trace.tb_frame) == _OURS:
        return False
    return trace.tb_frame.f_code.co_code[trace.tb_lasti] == dis.opmap["RAISE_VARARGS"]


def _is_foreign(frame: FrameType) -> bool:
    """Whether a frame is of a file that is neither this package's nor Python's own."""
    root = _root_of(frame)
    is_file = frame.f_code.co_filename.endswith(".py")
    return is_file and root != _OURS and root not in sys.stdlib_module_names


def _is_installed(frame: FrameType) -> bool:
    return not _INSTALLED.isdisjoint(Path(frame.f_code.co_filename).parts)


def _root_of(frame: FrameType) -> str:
    return _root(frame.f_globals.get("__name__", ""))


def _root(module: str) -> str:
    return module.partition(".")[0]


def _line(path: str, number: int) -> str:
    return f"{Path(path).name}, line {number}"
