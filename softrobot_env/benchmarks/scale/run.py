"""Robots on a core alone and in a batch, workers, shares of a training, and what jobs cost.

What one process does is measured in its own computing time, so that other programs do not count.
Several cores can only be compared with one while nothing else runs on them.
"""

import os
from collections.abc import Callable
from importlib.util import find_spec
from time import process_time

import gymnasium
import numpy as np

from softrobot_env.benchmarks.scale import jobs, shares
from softrobot_env.benchmarks.scale.rows import Row, cost_of
from softrobot_env.benchmarks.speed import scaling
from softrobot_env.core.jobs import Progress, quiet
from softrobot_env.core.processes import Workers, usable_cores
from softrobot_env.robots import find_robot

#: Robots that are timed: what `gymnasium.make_vec` takes.
_ROBOTS = {
    "arm": ("SoftRobot/ArmSwing-v0", None),
    "rig": ("SoftRobot/RigTriangle-v0", None),
    "hanging_trunk": ("SoftRobot/Track-v0", "hanging_trunk"),
    "ftdcr_v4": ("SoftRobot/Track-v0", "ftdcr_v4"),
}

#: Robots of a batch, share of full actions, and rounds of which the best counts.
_BATCH, _SHARE, _ROUNDS = 256, 0.2, 6

#: [s] of computing in a round; programs that run, per core, from which on the machine is busy.
_BLOCK, _BUSY = 0.3, 0.75


def run(quick: bool, progress: Progress | None = None) -> list[Row]:
    """Measure.

    Args:
        quick: Fewer repeats, and two robots.
        progress: Told what is done.
    """
    show, parts, busy = progress or quiet, 4, _others() > _BUSY
    show("robots", 0, parts)
    rows = []
    for name in list(_ROBOTS)[: 2 if quick else None]:
        rows += [_robots(name, count, quick) for count in (1, _BATCH)]
    rows.append(Row("robots", "arm", "GPU", failure="not measured"))
    show("workers", 1, parts)
    rows += _busy_workers() if busy else _workers(quick)
    show("trainings", 2, parts)
    if find_spec("stable_baselines3") is not None:
        rows += shares.run(quick)
    show("jobs", 3, parts)
    ways = {"processes": Workers(usable_cores())}
    if find_spec("ray") is not None:
        ways["Ray"] = Workers(ray="local")
    return rows + jobs.run(ways, quick)


def _others() -> float:
    """Programs that run on this machine, or wait for it, per core; mean of the last minute."""
    return os.getloadavg()[0] / usable_cores()


def _workers(quick: bool) -> list[Row]:
    """A row for each way to use several cores."""
    return [
        Row("workers", r.variant, cores=r.threads, efficiency=r.efficiency, started=r.started)
        for r in scaling.run(quick)
    ]


def _busy_workers() -> list[Row]:
    """Rows without numbers, which would tell of the other programs."""
    told = {"cores": usable_cores(), "failure": "not measured: other programs ran"}
    return [Row("workers", name, **told) for name in ("processes", "Ray", "threads of a batch")]


def _computing(do: Callable[[], object]) -> float:
    """Computing time [s] of a call, the mean of a block of them."""
    begin, count = process_time(), 0
    while process_time() - begin < _BLOCK:
        do()
        count += 1
    return (process_time() - begin) / count


def _robots(name: str, count: int, quick: bool) -> Row:
    """Robots in random motion, on one core."""
    env_id, robot = _ROBOTS[name]
    options = {} if robot is None else {"robot": find_robot(robot), "task": "reach"}
    env = gymnasium.make_vec(env_id, num_envs=count, threads=1, **options)
    env.reset(seed=0)
    actions = _SHARE * np.random.default_rng(0).uniform(-1, 1, env.action_space.shape)
    seconds = min(_computing(lambda: env.step(actions)) for _ in range(2 if quick else _ROUNDS))
    period = env.control_period
    env.close()
    way = "one" if count == 1 else "batch"
    return Row("robots", name, way, cores=1, **cost_of(count * period / seconds))
