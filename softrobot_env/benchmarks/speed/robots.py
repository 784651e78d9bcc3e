"""What environments of all kinds of robots cost, singly and in batches, against bare simulations.

Bare is the advance of as many simulations on as many threads, in the same motion.
"""

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np

from softrobot_env.benchmarks.speed.rows import Row, step_row
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.robots import EXAMPLES, find_robot

WHAT = "robots"

#: Numbers of robots in a batch; the first ones are quick.
COUNTS = (1, 16, 256)

#: Control periods of the motion, share of full actions, and time [s] spent on a row.
_PERIODS, _SHARE, _BUDGET = 10, 0.2, 2.0


def _environments() -> dict[str, tuple[str, dict[str, Any]]]:
    """Arm, rig, the examples, and a rod of 60 degrees of freedom that bends and twists."""
    rod = find_robot("silicone_rod")
    wound = tuple(replace(tendon, turns=0.25) for tendon in rod.tendons)
    rod = replace(rod, name="rod_60", pieces=10, tendons=wound)
    any_robot = {name: find_robot(name) for name in EXAMPLES} | {rod.name: rod}
    return {
        "arm": ("SoftRobot/ArmSwing-v0", {}),
        "rig": ("SoftRobot/RigTriangle-v0", {}),
        **{
            name: ("SoftRobot/Track-v0", {"robot": robot, "task": "reach"})
            for name, robot in any_robot.items()
        },
    }


def run(quick: bool) -> list[Row]:
    """A row for each robot and number of robots."""
    budget = _BUDGET / 10 if quick else _BUDGET
    return [
        _row(name, env_id, options, count, budget)
        for name, (env_id, options) in _environments().items()
        for count in (COUNTS[:2] if quick else COUNTS)
    ]


def _row(name: str, env_id: str, options: dict[str, Any], count: int, budget: float) -> Row:
    env = gymnasium.make_vec(env_id, num_envs=count, **options)
    rng = np.random.default_rng(0)
    actions = _SHARE * rng.uniform(-1, 1, env.action_space.shape)
    times: list[tuple[float, float]] = []
    begin = perf_counter()
    while len(times) < 3 or perf_counter() - begin < budget:
        stepped = _time(env, lambda: env.step(actions)[2])
        times.append((_time(env, env.simulation.advance), stepped))
    raw, seconds = np.min(times, axis=0).tolist()
    simulation = env.simulation
    row = step_row(WHAT, name, seconds, raw, count=count, threads=simulation.threads)
    return replace(row, dof=simulation.scene.model.nv)


def _time(env: VectorTrackingEnv, step: Callable[[], np.ndarray]) -> float:
    """Mean time [s] of a control period, after a first one that puts the actions in force.

    Raises:
        RuntimeError: A robot has failed.
    """
    env.reset(seed=0)
    env.step(_SHARE * np.random.default_rng(0).uniform(-1, 1, env.action_space.shape))
    begin = perf_counter()
    for _ in range(_PERIODS):
        failed = step()
    spent = perf_counter() - begin
    if failed.any():
        raise RuntimeError(f"{env.spec.id} failed while it was timed")
    return spent / _PERIODS
