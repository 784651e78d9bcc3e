"""Reference smoothing: unannounced jumps become motions that the arm can follow.

A jump that the preview shows is left as it is: a law with preview acts ahead of it.
"""

import numpy as np

from softrobot_env.beams.numerics.compilation import kernel

#: [m], distance of the reference from what the preview said that counts as a jump.
JUMP = 5e-3

#: [m/s2], largest acceleration of the motion that replaces a jump from rest.
ACCELERATION = 10.0

#: Largest acceleration of the quintic motion over unit distance in unit time.
_PEAK = 10 / np.sqrt(3)

#: Largest acceleration of the quintic that stops unit velocity in unit time, without moving.
_BRAKE = 4.0

#: Length of what `smoothed` remembers.
SIZE = 10


@kernel
def begin_smoothing(here: np.ndarray, memory: np.ndarray) -> None:
    """Set the memory (SIZE,) for a reference that was at a point (2,) [m] until now."""
    memory[:] = 0
    memory[7] = 1.0
    memory[8:] = here


@kernel
def smoothed(
    period: float, target: np.ndarray, times: np.ndarray, memory: np.ndarray, points: np.ndarray
) -> None:
    """Take unannounced jumps out of a reference.

    What a jump leaves to go decays along a quintic, which goes on with the velocity and
    acceleration of the motion after an earlier jump, in a time that its accelerations allow.

    Args:
        period: [s] between two calls.
        target: (2,) [m], present reference.
        times: (k,) [s] ahead, from 0 and one period on.
        memory: (SIZE,): offset [m] with velocity and acceleration (2,) each at the jump, age and
            duration [s] of the motion, reference (2,) announced for now; updated.
        points: (k, 2) [m], references at these times, changed.
    """
    start, announced = memory[:6].reshape(3, 2), memory[8:]
    if np.hypot(target[0] - announced[0], target[1] - announced[1]) > JUMP:
        here = _offset(start, memory[6], memory[7])
        start[:] = here
        for i in range(2):
            start[0, i] -= target[i] - announced[i]
        size, speed = np.hypot(start[0, 0], start[0, 1]), np.hypot(start[1, 0], start[1, 1])
        memory[6] = 0.0
        memory[7] = np.sqrt(_PEAK * size / ACCELERATION) + _BRAKE * speed / ACCELERATION
    announced[:] = points[1]
    for k in range(len(times)):
        here = _offset(start, memory[6] + times[k], memory[7])
        for i in range(2):
            points[k, i] += here[0, i]
    memory[6] += period


@kernel
def _offset(start: np.ndarray, age: float, duration: float) -> np.ndarray:
    """Offset, velocity and acceleration (3, 2) at an age [s], from those at the start (3, 2)."""
    out = np.zeros((3, 2))
    if age >= duration:
        return out
    t, end = age, duration
    for i in range(2):
        o, v, a = start[0, i], start[1, i] * end, start[2, i] * end**2
        c3 = -(20 * o + 12 * v + 3 * a) / 2
        c4 = (30 * o + 16 * v + 3 * a) / 2
        c5 = -(12 * o + 6 * v + a) / 2
        x = t / end
        out[0, i] = o + x * (v + x * (a / 2 + x * (c3 + x * (c4 + x * c5))))
        out[1, i] = (v + x * (a + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))) / end
        out[2, i] = (a + x * (6 * c3 + x * (12 * c4 + x * 20 * c5))) / end**2
    return out
