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


#: [m/s], below which it is not clear to which side a tendon lags.
_TURNING = 2e-3


def ahead_of(
    rate: np.ndarray, period: float, speed: float, lag: np.ndarray | float = 0.0
) -> np.ndarray:
    """What to add to commands [m] so that tendons are on average where they should be in a period.

    A servo takes a while, |rate| T / speed, for its way in a period; and a tendon lags behind its
    command by half of the servo's backlash, and by its friction over its stiffness.

    Args:
        rate: (m,) [m/s], of the lengths wanted.
        period: T [s].
        speed: [m/s], of the servos; inf if they are as fast as need be.
        lag: (m,) [m], of the tendons.
    """
    late = np.minimum(np.abs(rate), speed) * period / (2 * speed) * rate
    return late + lag * np.tanh(rate / _TURNING)
