"""Timing helpers: the least of several repeats, which other load disturbs least."""

from collections.abc import Callable
from time import perf_counter

import mujoco


def per_call(function: Callable[[], object], calls: int, repeats: int = 5) -> float:
    """Least mean time [s] of one call over several blocks of calls."""
    return min(_block(function, calls) for _ in range(repeats))


def _block(function: Callable[[], object], calls: int) -> float:
    begin = perf_counter()
    for _ in range(calls):
        function()
    return (perf_counter() - begin) / calls


def step_cost(model: mujoco.MjModel) -> float:
    """Time [s] of one `mj_step` from the initial state, call overhead excluded."""
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    return per_call(lambda: mujoco.mj_step(model, data, 200), calls=5) / 200
