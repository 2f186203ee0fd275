"""What Ctrl-C does while modules are being imported. Imports little itself, for it comes first."""

import os
import signal

INTERRUPTED = 130  # exit code
_ENDING = (signal.SIGINT, signal.SIGTERM)


class Importing:
    """While it is entered, Ctrl-C and SIGTERM wait; one that came ends the process, without a word.

    An exception would come out of whatever is half imported, as anything and with a traceback, and
    so it would out of the helpers that some packages start when they are imported.
    """

    def __enter__(self) -> None:
        found = {number: signal.getsignal(number) for number in _ENDING}
        # None is a handler of somebody else's, who is not written in Python.
        self._handlers = {
            number: handler for number, handler in found.items() if handler is not None
        }
        self._mask = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
        try:
            for number, handler in self._handlers.items():
                if handler is not signal.SIG_IGN:  # as nohup and a shell's & have it
                    signal.signal(number, _end)
        except ValueError:  # Python handles signals in its main thread only
            self._handlers = {}

    def __exit__(self, *_: object) -> None:
        signal.pthread_sigmask(signal.SIG_SETMASK, self._mask)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)


def _end(*_: object) -> None:
    os._exit(INTERRUPTED)
