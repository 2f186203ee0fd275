"""What happens around the import of modules. Imports little itself, for it comes first."""

import os
import signal

INTERRUPTED = 130  # exit code
_ENDING = (signal.SIGINT, signal.SIGTERM)
_GRAPHICS = "MUJOCO_GL"


class WithoutGraphics:
    """While it is entered, MuJoCo is imported without graphics, here and by processes that start.

    With them it imports GLFW, which starts a Python to ask for the version of its library. That
    takes time, and a process that is killed meanwhile leaves its helper without the line that it
    reads, which it says with a traceback. Films are drawn by processes of their own; what the user
    has chosen stays.

    Enter it where no other thread starts a process: one that starts while the environment is being
    written can fail to, with exit code 255.
    """

    def __enter__(self) -> None:
        self._chosen = _GRAPHICS in os.environ
        os.environ.setdefault(_GRAPHICS, "disable")

    def __exit__(self, *_: object) -> None:
        if not self._chosen:
            os.environ.pop(_GRAPHICS, None)


class Importing(WithoutGraphics):
    """While it is entered, Ctrl-C and SIGTERM wait; one that came ends the process, without a word.

    An exception would come out of whatever is half imported, as anything and with a traceback, and
    so it would out of the helpers that some packages start when they are imported.
    """

    def __enter__(self) -> None:
        super().__enter__()
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

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        signal.pthread_sigmask(signal.SIG_SETMASK, self._mask)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)


def _end(*_: object) -> None:
    os._exit(INTERRUPTED)
