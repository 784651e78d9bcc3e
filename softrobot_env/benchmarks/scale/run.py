"""Robots on a core alone and in a batch, workers, shares of a training, and what jobs cost."""

from importlib.util import find_spec

import gymnasium
import numpy as np

from softrobot_env.benchmarks.jobs import Progress, quiet
from softrobot_env.benchmarks.scale import jobs, shares
from softrobot_env.benchmarks.scale.rows import Row, cost_of
from softrobot_env.benchmarks.speed import scaling
from softrobot_env.benchmarks.speed.vector import least_times
from softrobot_env.processes import Workers, usable_cores
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


def run(quick: bool, progress: Progress | None = None) -> list[Row]:
    """Measure.

    Args:
        quick: Fewer repeats, and two robots.
        progress: Told what is done.
    """
    show, parts = progress or quiet, 4
    show("robots", 0, parts)
    rows = []
    for name in list(_ROBOTS)[: 2 if quick else None]:
        rows += [_robots(name, count, quick) for count in (1, _BATCH)]
    rows.append(Row("robots", "arm", "GPU", failure="not measured"))
    show("workers", 1, parts)
    for row in scaling.run(quick):
        measured = {"efficiency": row.efficiency, "started": row.started}
        rows.append(Row("workers", row.variant, cores=row.threads, **measured))
    show("trainings", 2, parts)
    if find_spec("stable_baselines3") is not None:
        rows += shares.run(quick)
    show("jobs", 3, parts)
    ways = {"processes": Workers(usable_cores())}
    if find_spec("ray") is not None:
        ways["Ray"] = Workers(ray="local")
    return rows + jobs.run(ways, quick)


def _robots(name: str, count: int, quick: bool) -> Row:
    """Robots in random motion, on one core."""
    env_id, robot = _ROBOTS[name]
    options = {} if robot is None else {"robot": find_robot(robot), "task": "reach"}
    env = gymnasium.make_vec(env_id, num_envs=count, threads=1, **options)
    env.reset(seed=0)
    actions = _SHARE * np.random.default_rng(0).uniform(-1, 1, env.action_space.shape)
    (seconds,) = least_times(2 if quick else _ROUNDS, lambda: env.step(actions))
    period = env.control_period
    env.close()
    way = "one" if count == 1 else "batch"
    return Row("robots", name, way, cores=1, **cost_of(count * period / seconds))
