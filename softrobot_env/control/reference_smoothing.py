"""Reference smoothing: unannounced jumps become motions that a robot can follow.

A jump that the preview shows is left unchanged: a law with preview acts ahead of it.
"""

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel

#: Largest acceleration of the quintic motion over unit distance in unit time.
_PEAK = 10 / np.sqrt(3)

#: Largest acceleration of the quintic that stops unit velocity in unit time, without moving.
_BRAKE = 4.0


def memory_size(dimensions: int) -> int:
    """Length of the memory of `smoothed` for a reference with so many coordinates."""
    return 4 * dimensions + 2


@kernel
def begin_smoothing(here: ndarray, memory: ndarray) -> None:
    """Initialise the memory for a reference that has been at a point (d,) [m] until now."""
    d = len(here)
    memory[:] = 0
    memory[3 * d + 1] = 1.0
    memory[3 * d + 2 :] = here


@kernel
def smoothed(
    period: float,
    target: ndarray,
    times: ndarray,
    jump: float,
    acceleration: float,
    memory: ndarray,
    points: ndarray,
) -> None:
    """Replace unannounced jumps of a reference by smooth motions.

    The gap after a jump decays along a quintic, which continues the velocity and acceleration of
    the motion after an earlier jump, in a time that its acceleration limit allows.

    Args:
        period: [s] between two calls.
        target: (d,) [m], present reference.
        times: (k,) [s] ahead, from 0 and one period on.
        jump: [m], distance from the previewed point that counts as a jump.
        acceleration: [m/s2], largest of the motion that replaces a jump from rest.
        memory: Offset [m] with velocity and acceleration (d,) each at the jump, age and duration
            [s] of the motion, reference (d,) previewed for now; updated.
        points: (k, d) [m], references at these times, modified.
    """
    d = len(target)
    start, motion, announced = memory[: 3 * d].reshape(3, d), memory[3 * d :], memory[3 * d + 2 :]
    if _size(target - announced) > jump:
        start[:] = _offset(start, motion[0], motion[1])
        for i in range(d):
            start[0, i] -= target[i] - announced[i]
        motion[0] = 0.0
        motion[1] = np.sqrt(_PEAK * _size(start[0]) / acceleration)
        motion[1] += _BRAKE * _size(start[1]) / acceleration
    announced[:] = points[1]
    for k in range(len(times)):
        if motion[0] + times[k] >= motion[1]:
            break  # nothing is left of the jump
        here = _offset(start, motion[0] + times[k], motion[1])
        for i in range(d):
            points[k, i] += here[0, i]
    motion[0] += period


@kernel
def _size(vector: ndarray) -> float:
    """Length of a vector (d,)."""
    total = 0.0
    for value in vector:
        total += value * value
    return np.sqrt(total)


@kernel
def _offset(start: ndarray, age: float, duration: float) -> ndarray:
    """Offset, velocity and acceleration (3, d) at an age [s], from those at the start (3, d)."""
    out = np.zeros_like(start)
    if age >= duration:
        return out
    t, end = age, duration
    for i in range(start.shape[1]):
        o, v, a = start[0, i], start[1, i] * end, start[2, i] * end**2
        c3 = -(20 * o + 12 * v + 3 * a) / 2
        c4 = (30 * o + 16 * v + 3 * a) / 2
        c5 = -(12 * o + 6 * v + a) / 2
        x = t / end
        out[0, i] = o + x * (v + x * (a / 2 + x * (c3 + x * (c4 + x * c5))))
        out[1, i] = (v + x * (a + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))) / end
        out[2, i] = (a + x * (6 * c3 + x * (12 * c4 + x * 20 * c5))) / end**2
    return out
