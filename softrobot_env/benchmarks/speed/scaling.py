"""How much faster several cores are than one: processes of this machine, Ray, threads of a batch.

Every job steps an arm. Efficiency is how much faster all cores are than one, over their number.
"""

from functools import partial
from importlib.util import find_spec
from time import perf_counter

import gymnasium
import numpy as np

from softrobot_env.benchmarks.speed.rows import Row
from softrobot_env.core.processes import Workers, usable_cores, using, worker_processes

WHAT = "scaling"

#: [s] of a job, jobs per core, robots of a batch; rounds of which the best counts.
_JOB, _QUICK_JOB, _EACH, _ROBOTS, _ROUNDS = 5.0, 0.5, 2, 256, 5

_ID = "SoftRobot/ArmSwing-v0"


def run(quick: bool) -> list[Row]:
    """A row for processes, for Ray if it is installed, and for the threads of a batch."""
    cores = usable_cores()
    ways = {"processes": Workers(cores)}
    if find_spec("ray") is not None:
        ways["Ray"] = Workers(ray="local")
    target = _QUICK_JOB if quick else _JOB
    steps = max(1, round(target / step_arm(2000) * 2000))
    rows = []
    for name, workers in ways.items():
        # What other programs take counts least in the best round.
        found = [_jobs(workers, cores, steps) for _ in range(1 if quick else 2)]
        started, efficiency, seconds = max(found, key=lambda each: each[1])
        times = {"seconds": seconds, "started": started}
        rows.append(Row(WHAT, name, threads=cores, efficiency=efficiency, **times))
    return [*rows, _threads(cores)]


def step_arm(count: int) -> float:
    """Time [s] of some steps of an arm that swings."""
    env = gymnasium.make(_ID).unwrapped
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    env.step(action)
    begin = perf_counter()
    for number in range(count):
        if number % 1000 == 999:
            env.reset(seed=0)
        env.step(action)
    return perf_counter() - begin


def _jobs(workers: Workers, cores: int, steps: int) -> tuple[float, float, float]:
    """Time [s] to start, efficiency of several jobs at once, and time [s] of a job alone."""
    begin = perf_counter()
    with using(workers), worker_processes(cores) as pool:
        list(pool.map(step_arm, [1] * 4 * cores))  # each process loads what it needs
        started = perf_counter() - begin
        alone = pool.submit(step_arm, steps).result()
        begin = perf_counter()
        list(pool.map(step_arm, [steps] * _EACH * cores))
        taken = perf_counter() - begin
    return started, _EACH * alone / taken, alone


def _threads(cores: int) -> Row:
    """A batch on one thread and on all."""
    times = {}
    for threads in (1, cores):
        env = gymnasium.make_vec(_ID, num_envs=_ROBOTS, threads=threads)
        env.reset(seed=0)
        step = partial(env.step, np.zeros(env.action_space.shape, dtype=np.float32))
        step()
        rounds = []
        for _ in range(_ROUNDS):
            begin = perf_counter()
            for _ in range(10):
                step()
            rounds.append((perf_counter() - begin) / 10)
        times[threads] = min(rounds)
        env.close()
    efficiency = times[1] / times[cores] / cores
    return Row(
        WHAT, "threads of a batch", _ROBOTS, cores, seconds=times[cores], efficiency=efficiency
    )
