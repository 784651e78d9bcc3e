"""What a simulated motion is, alike for beam models and compiled scenes."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import ndarray


class IntegrationError(RuntimeError):
    """Time integration failed.

    Attributes:
        time: [s] that was reached.
    """

    def __init__(self, message: str, time: float) -> None:
        super().__init__(message)
        self.time = time


class State(NamedTuple):
    """Coordinates and velocities."""

    q: ndarray
    v: ndarray


@dataclass(frozen=True)
class Motion:
    """A simulated motion.

    Attributes:
        time: (k,) [s].
        q, v: Coordinates and velocities, a row for each instant.
    """

    time: ndarray
    q: ndarray
    v: ndarray

    @property
    def end(self) -> State:
        """The last state."""
        return State(self.q[-1].copy(), self.v[-1].copy())


def sample_times(duration: float, samples: ndarray | float | None) -> ndarray:
    """Instants (k,) [s] of a motion that are kept.

    Args:
        duration: [s].
        samples: The instants from 0 to the duration, or their distance [s]; start and end if None.

    Raises:
        ValueError: The duration is not positive, or the samples do not fit it.
    """
    if not 0 < duration < np.inf:
        raise ValueError(f"duration must be positive, got {duration!r}")
    if samples is None:
        return np.array([0.0, duration])
    if np.ndim(samples) == 0:
        count = round(duration / samples) if samples > 0 else 0
        if count < 1 or abs(count * samples - duration) > 1e-9 * duration:
            raise ValueError(f"the distance of samples must divide {duration} s, got {samples!r}")
        return np.linspace(0.0, duration, count + 1)
    times = np.array(samples, float)
    rises = times.ndim == 1 and times.size > 1 and np.all(np.diff(times) > 0)
    if not rises or times[0] != 0 or times[-1] != duration:
        raise ValueError("samples must start at 0, increase and end at the duration")
    return times
