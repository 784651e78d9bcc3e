"""Jumps of the reference, replaced by smooth motions that the arm can follow."""

import numpy as np

from softrobot_env.beams.compilation import kernel

#: [m], change of the reference between two decisions that counts as a jump.
JUMP = 5e-3

#: [m/s2], largest acceleration of the motion that replaces a jump.
ACCELERATION = 10.0

#: Largest acceleration of the quintic motion over unit distance in unit time.
_PEAK = 10 / np.sqrt(3)

#: Length of what `smoothed` remembers.
SIZE = 6


@kernel
def begin_smoothing(here: np.ndarray, memory: np.ndarray) -> None:
    """Set the memory (SIZE,) for a reference that was at a point (2,) [m] until now."""
    memory[:] = 0
    memory[3] = 1.0
    memory[4:] = here


@kernel
def smoothed(
    period: float, target: np.ndarray, times: np.ndarray, memory: np.ndarray, points: np.ndarray
) -> None:
    """Take the jumps out of a reference.

    After a jump, what is left of it decays along the quintic of least jerk, in the time that its
    largest acceleration allows.

    Args:
        period: [s] between two calls.
        target: (2,) [m], present reference.
        times: (k,) [s] ahead.
        memory: (SIZE,): offset (2,) [m], age and duration [s] of the motion, last target; updated.
        points: (k, 2) [m], references at these times, changed.
    """
    offset, last = memory[:2], memory[4:]
    if np.hypot(target[0] - last[0], target[1] - last[1]) > JUMP:
        left = _left(memory[2], memory[3])
        for i in range(2):
            offset[i] = left * offset[i] - (target[i] - last[i])
        memory[2] = 0.0
        memory[3] = np.sqrt(_PEAK * np.hypot(offset[0], offset[1]) / ACCELERATION)
    last[:] = target
    for k in range(len(times)):
        left = _left(memory[2] + times[k], memory[3])
        points[k, 0] += left * offset[0]
        points[k, 1] += left * offset[1]
    memory[2] += period


@kernel
def _left(age: float, duration: float) -> float:
    """Share of the jump that is left."""
    x = min(age / duration, 1.0)
    return 1 - x**3 * (10 - 15 * x + 6 * x**2)
