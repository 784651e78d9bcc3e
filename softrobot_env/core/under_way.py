"""Says what is under way where nothing else has said so for a while: a line on standard error."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import parent_process
from threading import Event, Lock, Thread
from time import perf_counter

#: Longest silence [s]; where work takes long, this share [1] of its time.
GAP, SHARE = 1.5, 0.03

#: Whether anything is said.
SPEAKS = True

#: What is under way, the innermost last, and what tells it.
_Text = Callable[[], str]
_texts: list[_Text | None] = []
_lock = Lock()
_voice: "_Voice | None" = None


class _Voice(Thread):
    """Speaks from the beginning of the outermost work to its end.

    Attributes:
        over: Set at the end.
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.over, self._began = Event(), perf_counter()
        self._last = self._began

    def run(self) -> None:
        """Wait, and speak when it is time."""
        while not self.over.wait(self._left()):
            with _lock:
                text = _texts[-1] if _texts else None
            if self._left() <= 0:
                self.say("" if text is None else text())

    def _left(self) -> float:
        """Time [s] until something is to be said."""
        now = perf_counter()
        return max(self._last + max(GAP, SHARE * (now - self._began)) - now, 0.0)

    def say(self, text: str) -> None:
        """Write a line, with the time since the beginning; nothing if it is empty."""
        self._last = perf_counter()
        if text:
            sys.stderr.write(f"{text}, {self._last - self._began:.0f} s\n")
            sys.stderr.flush()


def begin(text: _Text | None) -> None:
    """Work begins, of which the text is said; None: it says so itself, as a bar does."""
    global _voice
    if not SPEAKS or parent_process() is not None or sys.stderr is None:  # workers are silent
        return
    with _lock:
        _texts.append(text)
        if _voice is None:
            _voice = _Voice()
            _voice.start()


def end(text: _Text | None) -> None:
    """It ends."""
    global _voice
    silenced = None
    with _lock:
        if text in _texts:
            del _texts[len(_texts) - 1 - _texts[::-1].index(text)]
        if not _texts:
            silenced, _voice = _voice, None
    if silenced is not None:
        silenced.over.set()
        silenced.join()


def tell(text: str) -> None:
    """Say at once what begins, where something is under way that does not say so itself."""
    with _lock:
        voice = _voice if _texts and _texts[-1] is not None else None
    if voice is not None:
        voice.say(text)


@contextmanager
def under_way(text: _Text | None) -> Iterator[None]:
    """From `begin` to `end`."""
    begin(text)
    try:
        yield
    finally:
        end(text)
