"""What the signals that end a process do to it: Ctrl-C, TERM, and HUP of a closed terminal."""

import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

GRACE_S = 1.0  # a second signal within this time changes nothing

ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)

Handler = Callable[[int, FrameType | None], Any]


def on_ending(handler: Handler) -> dict[int, Any]:
    """Let a handler have these signals, but those that this process ignores, as under nohup.

    It must wait for no lock: the main thread, which it interrupts, may hold that.

    Returns:
        The handlers before; none, and nothing is changed, outside the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        return {}
    deaf = (signal.SIG_IGN, None)  # None: somebody else's, who is not written in Python
    heard = [number for number in ENDING if signal.getsignal(number) not in deaf]
    return {number: signal.signal(number, handler) for number in heard}


def set_on_ending(event: threading.Event) -> None:
    """Let each of these signals set an event.

    Inside `event.wait` the main thread may hold the lock that `event.set` waits for: so another
    thread sets it.
    """
    came: queue.SimpleQueue[int] = queue.SimpleQueue()  # its put waits for no lock

    def set_it() -> None:
        came.get()
        event.set()

    threading.Thread(target=set_it, daemon=True).start()
    on_ending(lambda number, _: came.put(number))


@contextmanager
def interruptible() -> Iterator[None]:
    """Let each of these signals raise KeyboardInterrupt."""
    before = on_ending(_Interrupt())
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Interrupt:
    """Raises KeyboardInterrupt, but not twice at once: a closing terminal sends HUP repeatedly."""

    def __init__(self) -> None:
        self._last = -GRACE_S

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        if time.monotonic() - self._last >= GRACE_S:
            self._last = time.monotonic()
            raise KeyboardInterrupt


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let what is inside come to its end; a signal that came meanwhile interrupts after it."""
    came: list[int] = []
    before = on_ending(lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt
