"""Something that must be closed however a program ends."""

import atexit
import signal
import threading
from collections.abc import Callable
from types import FrameType


class ExitGuard:
    """Calls a function when the interpreter ends, or when it gets SIGTERM.

    The signal then goes on to whoever had it before. Only Python's main thread can be told of
    signals; elsewhere the guard does without.
    """

    def __init__(self, close: Callable[[], None]) -> None:
        self._close = close
        self._previous: signal.Handlers | Callable | int | None = None

    def install(self) -> None:
        """Begin; twice is harmless."""
        self.remove()
        atexit.register(self._close)
        if threading.current_thread() is threading.main_thread():
            self._previous = signal.getsignal(signal.SIGTERM)
        if self._previous is not None:
            signal.signal(signal.SIGTERM, self._handle)

    def remove(self) -> None:
        """End; the previous handler gets its signal back."""
        atexit.unregister(self._close)
        in_main = threading.current_thread() is threading.main_thread()
        if in_main and signal.getsignal(signal.SIGTERM) == self._handle:
            signal.signal(signal.SIGTERM, self._previous)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._close()
        signal.signal(signal.SIGTERM, self._previous)
        signal.raise_signal(number)
