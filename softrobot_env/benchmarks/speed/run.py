"""Environment steps per second, and what the Python side of a step costs.

The overhead of an environment is the time of `env.step` minus that of the `mj_step` calls it makes.
Ours and Gymnasium's own MuJoCo environments are timed in turns within one run, each by its best
block, so that their ratio does not depend on the machine's load.
"""

from dataclasses import dataclass
from time import perf_counter

import gymnasium
import mujoco
import numpy as np

from softrobot_env.benchmarks.jobs import Progress, quiet
from softrobot_env.benchmarks.speed import vector
from softrobot_env.benchmarks.speed.rows import Row, step_row
from softrobot_env.benchmarks.speed.startup import frame_time, startup_times
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.registration import ENVIRONMENTS

#: Gymnasium's environments to compare with; the first one is the yardstick.
YARDSTICKS = ("HalfCheetah-v5", "Reacher-v5", "InvertedDoublePendulum-v5")

#: Control steps per block: short, so that some block of many runs undisturbed.
_STEPS = 100


@dataclass
class _Contestant:
    """An environment under test and its best times [s] per control step."""

    name: str
    env: gymnasium.Env
    action: np.ndarray
    substeps: int
    step_time: float = np.inf
    raw_time: float = np.inf


def run(quick: bool, progress: Progress | None = None) -> list[Row]:
    """Time the environments, the start of the package and a rendered frame.

    Args:
        quick: Fewer repeats.
        progress: Called with description, done, total.

    Returns:
        Rows of single environments, vector environments and waits.
    """
    contestants = [_contestant(name) for name in (*YARDSTICKS, *ENVIRONMENTS)]
    rounds, show = 80 if quick else 300, progress or quiet
    for done in range(rounds):
        show("env.step", done, rounds)
        for contestant in contestants:
            _time_block(contestant)
    yardstick = contestants[0].step_time - contestants[0].raw_time
    waits = {("start", name): t for name, t in startup_times(2 if quick else 5).items()}
    waits["render", "frame 640 x 480"] = frame_time()
    show("vector environments", rounds, rounds)
    steps = [
        step_row("env.step", c.name, c.step_time, c.raw_time, yardstick=yardstick)
        for c in contestants
    ]
    return steps + vector.run(quick) + [Row(*w, seconds=time) for w, time in waits.items()]


def _contestant(name: str) -> _Contestant:
    env = gymnasium.make(name)
    env.reset(seed=0)
    bare = env.unwrapped
    own = isinstance(bare, TrackingEnv)
    substeps = round(bare.control_period / bare.model.opt.timestep) if own else bare.frame_skip
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    return _Contestant(name, env, action, substeps)


def _time_block(contestant: _Contestant) -> None:
    """One block of environment steps, and one of the bare `mj_step` calls of the same motion."""
    env, action, substeps = contestant.env, contestant.action, contestant.substeps
    env.reset(seed=0)
    begin = perf_counter()
    for _ in range(_STEPS):
        env.step(action)
    step_time = (perf_counter() - begin) / _STEPS
    env.reset(seed=0)
    model, data = env.unwrapped.model, env.unwrapped.data
    data.ctrl[:] = 0.0  # what the zero action means to all of them
    begin = perf_counter()
    for _ in range(_STEPS):
        mujoco.mj_step(model, data, substeps)
    raw_time = (perf_counter() - begin) / _STEPS
    contestant.step_time = min(contestant.step_time, step_time)
    contestant.raw_time = min(contestant.raw_time, raw_time)
