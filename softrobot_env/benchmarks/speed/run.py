"""Environment steps per second, what the Python side of a step costs, and decisions.

The overhead of an environment is the time of `env.step` minus that of the bare simulation in it:
`mj_step` of Gymnasium's environments, a control period of ours. Ours and Gymnasium's own MuJoCo
environments are timed in turns within one run, each by its best block, so that their ratio does not
depend on the machine's load.
"""

from collections.abc import Callable
from time import perf_counter

import gymnasium
import mujoco
import numpy as np

from softrobot_env.benchmarks.speed import decisions, moving, robots, scaling, vector, warp
from softrobot_env.benchmarks.speed.rows import Row, step_row
from softrobot_env.benchmarks.speed.startup import frame_time, startup_times
from softrobot_env.core.jobs import Progress, quiet
from softrobot_env.envs.base import EpisodeEnv
from softrobot_env.registration import ENVIRONMENTS
from softrobot_env.scene.simulation import Simulation

#: Gymnasium's environments to compare with; the first one is the yardstick.
YARDSTICKS = ("HalfCheetah-v5", "Reacher-v5", "InvertedDoublePendulum-v5")

#: Of the rig, its tasks differ in the reference alone.
RIG = "SoftRobot/RigTriangle-v0"

#: Control steps per block: short, so that some block of many runs undisturbed.
_STEPS = 100


def run(quick: bool, progress: Progress | None = None) -> list[Row]:
    """Time the environments, the start of the package and a rendered frame.

    Args:
        quick: Fewer repeats.
        progress: Called with description, done, total.

    Returns:
        Rows of single environments, of a moving arm by accuracy, of vector environments, also on
        MuJoCo Warp, of batches of robots, of decisions, of several cores and waits.
    """
    contestants = {name: gymnasium.make(name) for name in (*YARDSTICKS, *ENVIRONMENTS, RIG)}
    rounds, show = 80 if quick else 300, progress or quiet
    blocks = []
    for done in range(rounds):
        show("env.step", done, rounds)
        blocks.append([_time_block(env) for env in contestants.values()])
    times = dict(zip(contestants, np.min(blocks, axis=0).tolist(), strict=True))
    stepped, bare = times[YARDSTICKS[0]]
    waits = {("start", name): t for name, t in startup_times(2 if quick else 5).items()}
    waits["render", "frame 640 x 480"] = frame_time()
    show("vector environments", rounds, rounds)
    steps = [step_row("env.step", name, *t, yardstick=stepped - bare) for name, t in times.items()]
    steps += moving.run(quick) + vector.run(quick) + warp.run(quick) + robots.run(quick)
    steps += decisions.run(quick, show)
    show("several cores", rounds, rounds)
    steps += scaling.run(quick)
    return steps + [Row(*w, seconds=time) for w, time in waits.items()]


def _time_block(env: gymnasium.Env) -> tuple[float, float]:
    """Times [s] per step, in one block of steps and in one of the bare simulations in them."""
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    env.reset(seed=0)
    step_time = _time(lambda: env.step(action))
    env.reset(seed=0)
    return step_time, _time(_bare(env.unwrapped))


def _bare(env: gymnasium.Env) -> Callable[[], object]:
    """The simulation in a step of an environment that was reset, under its zero action."""
    model, data = env.model, env.data
    if not isinstance(env, EpisodeEnv):
        data.ctrl[:] = 0.0
        return lambda: mujoco.mj_step(model, data, env.frame_skip)
    simulation = Simulation(env.scene)
    simulation.reset(data.qpos, np.zeros(model.nu))
    return simulation.advance


def _time(do: Callable[[], object]) -> float:
    """Time [s] of a call in a block."""
    begin = perf_counter()
    for _ in range(_STEPS):
        do()
    return (perf_counter() - begin) / _STEPS
