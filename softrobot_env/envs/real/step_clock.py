"""Control periods kept by absolute deadlines."""

import time
from collections.abc import Callable
from math import floor


class StepClock:
    """When steps are due. Lateness never builds up, and missed steps are never made up for."""

    def __init__(
        self,
        period: float,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """A clock with a period [s]."""
        self._period, self._now, self._sleep = period, now, sleep
        self._due = 0.0

    def start(self) -> None:
        """The first step is due now."""
        self._due = self._now()

    def begin(self) -> tuple[float, int]:
        """A step begins.

        Returns:
            Lateness [s], and how many whole periods are skipped: none when late by less than half
            a period, as the next deadline is still met.
        """
        late = self._now() - self._due
        missed = floor(late / self._period + 0.5) if late > 0 else 0
        self._due += missed * self._period
        return late, missed

    @property
    def deadline(self) -> float:
        """[s], end of the step that has begun."""
        return self._due + self._period

    def finish(self) -> None:
        """Wait for the end of the step."""
        self._due += self._period
        left = self._due - self._now()
        if left > 0:
            self._sleep(left)
