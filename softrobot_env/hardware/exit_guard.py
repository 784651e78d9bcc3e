"""Something that must be closed however a program ends."""

import atexit
import os
import signal
import threading
from collections.abc import Callable
from types import FrameType


class ExitGuard:
    """Calls a function when the interpreter ends, or when it gets SIGTERM.

    The signal then goes on to whoever had it before. Only Python's main thread can be told of
    signals; elsewhere the guard does without. What a process has opened is its own: in a forked
    child the guard does nothing.
    """

    def __init__(self, close: Callable[[], None]) -> None:
        self._close, self._owner = close, os.getpid()
        self._previous: signal.Handlers | Callable | int | None = None

    def install(self) -> None:
        """Begin; twice is harmless."""
        self.remove()
        atexit.register(self._close_own)
        if _in_main_thread():
            self._previous = signal.getsignal(signal.SIGTERM)
            if self._previous is not None:
                signal.signal(signal.SIGTERM, self._handle)

    def remove(self) -> None:
        """End; the previous handler gets its signal back."""
        atexit.unregister(self._close_own)
        if _in_main_thread() and signal.getsignal(signal.SIGTERM) == self._handle:
            signal.signal(signal.SIGTERM, self._previous)

    def _close_own(self) -> None:
        if os.getpid() == self._owner:
            self._close()

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._close_own()
        signal.signal(signal.SIGTERM, self._previous)
        signal.raise_signal(number)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
