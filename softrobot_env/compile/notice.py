"""Says to who watches that something is being compiled, which takes long once."""

from threading import Lock
from typing import Any

from numba.core import event

from softrobot_env.core import under_way


class Notice(event.Listener):
    """Watches what Numba compiles; what is loaded from the cache counts for nothing.

    Attributes:
        count: Functions compiled so far.
    """

    def __init__(self) -> None:
        self.count, self._depth = 0, 0
        self._lock = Lock()

    def on_start(self, _: Any) -> None:
        """A function begins to be compiled, perhaps for another one."""
        with self._lock:
            self._depth += 1
            if self._depth == 1:
                under_way.begin(self._text)

    def on_end(self, _: Any) -> None:
        """It is compiled."""
        with self._lock:
            self._depth, self.count = self._depth - 1, self.count + 1
            if self._depth == 0:
                under_way.end(self._text)

    def _text(self) -> str:
        return f"compiling, once (softrobot warm-up does it ahead): {self.count} functions"


NOTICE = Notice()
event.register("numba:compile", NOTICE)
