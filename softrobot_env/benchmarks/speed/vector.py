"""Steps per second of many environments at once, against bare simulations and processes."""

from collections.abc import Callable
from time import perf_counter

import gymnasium
import numpy as np

from softrobot_env.benchmarks.speed.rows import Row, step_row
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.envs.vector import VectorTrackingEnv

_WHAT = "vector env.step"
_ENV_ID = "SoftRobot/ArmSwing-v0"

#: (environments, threads) of the batched environment.
CASES = ((16, 1), (16, 2), (16, 4), (256, 1), (256, 2))

#: Processes of Gymnasium's AsyncVectorEnv; more share the same cores and only need more memory.
_PROCESSES = 16

#: [s] of a block.
_BLOCK = 0.3


def _in_turns(rounds: int, *actions: Callable[[], object]) -> list[float]:
    """Least time [s] of each of some things done in turns, over some rounds."""
    return np.min([[_timed(do) for do in actions] for _ in range(rounds)], axis=0).tolist()


def _timed(do: Callable[[], object]) -> float:
    """Mean time [s] of a call in a block."""
    begin, count = perf_counter(), 0
    while perf_counter() - begin < _BLOCK:
        do()
        count += 1
    return (perf_counter() - begin) / count


def run(quick: bool) -> list[Row]:
    """Rows, whose ratio is that to bare simulations of the same scene."""
    # Processes first: they are forked, and the simulations below reserve much memory.
    processes = _processes(quick)
    rows = []
    for count, threads in CASES[-1:] if quick else CASES:
        times = _in_turns(2 if quick else 6, *_batched(count, threads))
        rows.append(step_row(_WHAT, "VectorTrackingEnv", *times, count=count, threads=threads))
    return [*rows, processes]


def _processes(quick: bool) -> Row:
    """Row of Gymnasium's environments in processes."""
    env = gymnasium.make_vec(_ENV_ID, num_envs=_PROCESSES, vectorization_mode="async")
    env.reset(seed=0)
    actions = np.zeros(env.action_space.shape, np.float32)
    (least,) = _in_turns(2 if quick else 6, lambda: env.step(actions))
    env.close()
    sizes = {"count": _PROCESSES, "threads": _PROCESSES}
    return step_row(_WHAT, "AsyncVectorEnv of the same", least, None, **sizes)


def _batched(count: int, threads: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """Our environment's step, and the bare step of as many simulations in the same motion."""
    env = VectorTrackingEnv(count, "swing", threads=threads)
    env.reset(seed=0)
    actions = np.zeros((count, 3), np.float32)
    single = TrackingEnv("swing")
    single.reset()
    bare = BatchSimulation(single.scene, count, threads)
    # A moving arm costs more than one at rest: both start bent, and swing without tension.
    start = single.data.qpos, np.zeros(single.model.nu)
    bare.reset(np.arange(count), *(np.tile(row, (count, 1)) for row in start))
    return lambda: env.step(actions), bare.advance
