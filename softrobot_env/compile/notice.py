"""Says to who watches that something is being compiled, which takes long once."""

import sys
from multiprocessing import parent_process
from threading import Event, Lock, Thread
from time import perf_counter
from typing import Any

from numba.core import event

#: Seconds before the first word, and between the next ones.
_PATIENCE, _PAUSE = 2.0, 5.0


class Notice(event.Listener):
    """Watches what Numba compiles; what is loaded from the cache counts for nothing.

    Attributes:
        count: Functions compiled so far.
        spent: [s] spent on them.
    """

    def __init__(self) -> None:
        self.count, self.spent = 0, 0.0
        self._depth, self._began = 0, 0.0
        self._lock, self._idle = Lock(), Event()

    def on_start(self, _: Any) -> None:
        """A function begins to be compiled, perhaps for another one."""
        with self._lock:
            self._depth += 1
            if self._depth > 1:
                return
            self._began = perf_counter()
            self._idle.clear()
        if _watched():
            Thread(target=self._tell, args=(self._idle,), daemon=True).start()

    def on_end(self, _: Any) -> None:
        """It is compiled."""
        with self._lock:
            self._depth, self.count = self._depth - 1, self.count + 1
            if self._depth == 0:
                self.spent += perf_counter() - self._began
                self._idle.set()
                self._idle = Event()

    def _tell(self, done: Event) -> None:
        """Write a line when it takes long, and then now and again."""
        while not done.wait(_PATIENCE):
            with self._lock:
                now = self.spent + perf_counter() - self._began
            print(
                f"compiling (once, about 30 s; softrobot warm-up does all): {now:.0f} s, "
                f"{self.count} functions",
                file=sys.stderr,
            )
            if done.wait(_PAUSE):
                return


def _watched() -> bool:
    """Whether somebody sees what is shown: at a terminal or in a notebook, not in workers."""
    if parent_process() is not None or sys.stderr is None:
        return False
    return sys.stderr.isatty() or "ipykernel" in sys.modules


NOTICE = Notice()
event.register("numba:compile", NOTICE)
