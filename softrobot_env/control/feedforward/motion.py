"""References as laws without feedback follow them: ahead of time, by drives that take a while."""

from typing import NamedTuple

import numpy as np


class Motion(NamedTuple):
    """A reference: (k,) each, [m, m/s, m/s2]."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    def after(self, time: float, jerk: np.ndarray | float) -> "Motion":
        """The motion `time` [s] later, with a constant jerk (k,) [m/s3]."""
        z, dz, ddz = self
        square = time * time / 2
        return Motion(
            z + time * dz + square * ddz + square * time / 3 * jerk,
            dz + time * ddz + square * jerk,
            ddz + time * jerk,
        )

    def ahead(self, time: float, before: np.ndarray | None, period: float) -> "Motion":
        """The same with the jerk since an acceleration (k,) a period [s] ago; None: no jerk."""
        return self.after(time, 0.0 if before is None else (self.acceleration - before) / period)


def on_time(rate: np.ndarray, period: float, speed: float) -> np.ndarray:
    """What to add to commands [m] so that servos are on average where they should be in a period.

    A servo takes a while, |rate| T / speed, for its way in a period.

    Args:
        rate: (m,) [m/s], of the lengths wanted.
        period: T [s].
        speed: [m/s], of the servos.
    """
    return np.minimum(np.abs(rate), speed) * period / (2 * speed) * rate
