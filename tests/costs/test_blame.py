"""Whatever a task's own code raises is one line that says what, and where."""

import _thread
import importlib
import re
import signal
import threading
from contextlib import nullcontext

import numpy as np
import pytest

from sumo_dist.costs.blame import blamed, caller, defined, truths_of, values_of
from sumo_dist.costs.view import View
from sumo_dist.errors import TaskError, UsageError
from sumo_dist.signals import interruptible
from sumo_dist.tasks.terms import distance

HERE = "test_blame.py, line "


def line_of(error, statement):
    """The line that an error names says this."""
    number = int(str(error).split(HERE)[1].split(":")[0])
    with open(__file__) as file:
        return file.readlines()[number - 1].strip() == statement


def test_the_line_is_the_tasks_own_and_not_that_of_what_it_calls():
    with pytest.raises(TaskError) as caught, blamed("reset"):
        np.zeros(3).reshape(2, 2)
    assert re.match(r"reset: test_blame.py, line \d+: ValueError: ", str(caught.value))
    assert line_of(caught.value, "np.zeros(3).reshape(2, 2)")
    assert isinstance(caught.value.__cause__, ValueError)


@pytest.mark.parametrize(
    ("folder", "place"),
    [
        ("beside", "helper_beside.py, line 2: ZeroDivisionError"),
        ("site-packages", HERE),  # what is installed is not at fault for how it is called
    ],
)
def test_the_line_may_be_in_a_helper_that_is_not_installed(folder, place, tmp_path, monkeypatch):
    name = f"helper_{folder[:6]}"
    (tmp_path / folder).mkdir()
    (tmp_path / folder / f"{name}.py").write_text("def deep():\n    return 1 / 0\n")
    monkeypatch.syspath_prepend(str(tmp_path / folder))
    module = importlib.import_module(name)
    with pytest.raises(TaskError) as caught, blamed("success"):
        module.deep()
    assert place in str(caught.value)


class _View:
    actions = np.zeros((2, 3, 1))


class Mute(Exception):
    def __str__(self):
        raise ValueError


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (SystemExit("no data"), "SystemExit: no data"),
        (SystemExit(3), "SystemExit: 3"),
        (KeyboardInterrupt(), "KeyboardInterrupt"),
        (AssertionError(), "AssertionError"),
        (UsageError("unknown frame 'lid'"), "unknown frame 'lid'"),
        (ValueError("two\n  lines"), "ValueError: two lines"),
        (OSError(2, "gone", "data.csv"), "FileNotFoundError: [Errno 2] gone: 'data.csv'"),
        (SyntaxError("bad", ("<string>", 7, 1, "x")), "SyntaxError: bad"),
        (Mute(), "Mute"),
        (ValueError("caf\udce9"), "ValueError: caf?"),
        (MemoryError("x" * 9000), "MemoryError: xxx"),
    ],
)
def test_whatever_is_raised_is_one_short_line(error, reason):
    with pytest.raises(TaskError) as caught, blamed("cost term 't'"):
        raise error
    text = str(caught.value)
    assert text.startswith("cost term 't': " + HERE) and reason in text
    assert "\n" not in text and len(text) <= 2000
    assert caught.value.exit_code == 2


def test_a_task_error_passes_as_it_is():
    with pytest.raises(TaskError, match=r"^inner: "), blamed("outer"), blamed("inner"):
        raise ValueError


@pytest.mark.parametrize("handled", ["by Python", "by the command line"])
def test_ctrl_c_is_nobodys_fault(handled):
    """A signal interrupts the code anywhere; none of its statements raises."""
    assert threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    ours = interruptible() if handled == "by the command line" else nullcontext()
    try:
        with ours, pytest.raises(KeyboardInterrupt), blamed("reset"):
            _thread.interrupt_main()
            while True:
                pass
    finally:
        signal.signal(signal.SIGINT, before)


def test_endless_recursion_is_one_line():
    def again():
        again()

    with pytest.raises(TaskError) as caught, blamed("reset"):
        again()
    assert ": RecursionError: maximum" in str(caught.value)
    assert line_of(caught.value, "again()")


def test_without_a_line_of_its_own_the_code_is_known_by_who_made_it():
    """A residual of ours that was made with the name of a frame that is not there."""
    view = View({}, np.zeros((2, 3, 1)))
    with pytest.raises(TaskError, match=r"^t: mine.py, line 3: unknown frame 'lid'"):
        values_of("t", distance("lid", "aim"), view, "mine.py, line 3")


def test_a_place_is_where_a_function_begins_and_where_a_call_stands():
    def mine(view):
        return view

    assert defined(mine) == f"{HERE}{mine.__code__.co_firstlineno}"
    assert defined(defined) == "" and defined(np.sin) == ""
    assert caller().startswith(HERE)


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (np.zeros((2, 2)), "shape (2, 2), must be (rollouts, steps) = (2, 3)"),
        (np.zeros((2, 3), complex), "returned complex128, must be numbers"),
        (np.full((2, 3), None), "returned object, must be numbers"),
        ([[1.0], [2.0, 3.0]], "ValueError: setting an array element"),
        (np.zeros((2, 3)), "returned float64, must be bool"),
    ],
)
def test_what_is_returned_must_be_a_row_per_rollout(value, reason):
    with pytest.raises(TaskError) as caught:
        truths_of("success", lambda _view: value, _View())
    assert reason in str(caught.value)
