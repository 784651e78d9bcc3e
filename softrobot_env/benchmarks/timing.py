"""Timing: the least of several repeats, which other load disturbs least."""

from collections.abc import Callable
from time import perf_counter
from typing import Any

import mujoco
import numpy as np

_STEPS = 200

#: Longest time [s] spent on the repeats of one measurement.
_BUDGET = 2.0


def best_of(
    action: Callable[[], Any], repeats: int, clock: Callable[[], float] = perf_counter
) -> tuple[float, Any]:
    """Shortest time [s] of some repetitions, fewer if they take long, and the last result.

    By `time.process_time` as a clock it is the computing time of all threads, which does not grow
    with what else runs on the machine.
    """
    best, spent, result = np.inf, 0.0, None
    for _ in range(repeats):
        begin = clock()
        result = action()
        took = clock() - begin
        best, spent = min(best, took), spent + took
        if spent > _BUDGET:
            break
    return best, result


def step_cost(
    model: mujoco.MjModel,
    posture: np.ndarray | None = None,
    ctrl: np.ndarray | None = None,
    repeats: int = 5,
) -> float:
    """Time [s] of one `mj_step` from a posture (nq,) under controls (nu,), else from the start."""
    data = mujoco.MjData(model)
    if posture is not None:
        data.qpos[:] = posture
    if ctrl is not None:
        data.ctrl[:] = ctrl
    mujoco.mj_step(model, data)
    return best_of(lambda: mujoco.mj_step(model, data, _STEPS), repeats)[0] / _STEPS
