"""Environment steps per second, and what the Python side of a step costs.

The overhead of an environment is the time of `env.step` minus that of the `mj_step` calls it makes.
Ours and Gymnasium's own MuJoCo environments are timed in turns within one run, each by its best
block, so that their ratio does not depend on the machine's load.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import gymnasium
import mujoco
import numpy as np
from rich import box
from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.speed import vector as vector_speed
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


def run(quick: bool, progress: Callable[[str, int, int], None] | None = None) -> list[dict]:
    """Time the environments, the start of the package and a rendered frame.

    Args:
        quick: Fewer repeats.
        progress: Called with description, done, total.

    Returns:
        Rows with what, variant, n_envs, threads, steps_per_second, raw_steps_per_second, ratio
        (of the two), overhead [s], overhead_ratio (to the first yardstick), and seconds [s] for
        what is no step.
    """
    contestants = [_contestant(name) for name in (*YARDSTICKS, *ENVIRONMENTS)]
    rounds = 80 if quick else 300
    for done in range(rounds):
        if progress:
            progress("env.step", done, rounds)
        for contestant in contestants:
            _time_block(contestant)
    yardstick = _overhead(contestants[0])
    waits = {("start", name): t for name, t in startup_times(2 if quick else 5).items()}
    waits["render", "frame 640 x 480"] = frame_time()
    if progress:
        progress("vector environments", rounds, rounds)
    steps = [_row(c, yardstick) for c in contestants] + vector_speed.run(quick)
    return steps + [_wait_row(*w) for w in waits.items()]


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


def _overhead(contestant: _Contestant) -> float:
    return contestant.step_time - contestant.raw_time


def _row(contestant: _Contestant, yardstick: float) -> dict:
    return {
        "what": "env.step",
        "variant": contestant.name,
        "n_envs": 1,
        "threads": 1,
        "steps_per_second": 1 / contestant.step_time,
        "raw_steps_per_second": 1 / contestant.raw_time,
        "ratio": contestant.raw_time / contestant.step_time,
        "overhead": _overhead(contestant),
        "overhead_ratio": _overhead(contestant) / yardstick,
        "seconds": contestant.step_time,
    }


def _wait_row(what: tuple[str, str], seconds: float | None) -> dict:
    names = ("n_envs", "threads", "steps_per_second", "raw_steps_per_second", "ratio")
    empty = dict.fromkeys((*names, "overhead", "overhead_ratio"))
    return {"what": what[0], "variant": what[1], **empty, "seconds": seconds}


def tables(rows: list[dict]) -> Group:
    """The rows for the terminal: one table of steps, one of waiting times."""
    steps = _empty_table(
        "envs x\nthreads", "steps/s", "raw/s", "raw/\nenv", "over-\nhead us", "over-\nhead ratio"
    )
    waits = _empty_table("ms")
    for row in rows:
        if row["steps_per_second"] is None:
            seconds = row["seconds"]
            waits.add_row(
                row["variant"], "no OpenGL" if seconds is None else f"{1e3 * seconds:.1f}"
            )
        else:
            steps.add_row(row["variant"], *_step_cells(row))
    return Group(steps, waits)


def _empty_table(*headings: str) -> Table:
    out = Table(header_style="bold", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    out.add_column("", no_wrap=True)
    for heading in headings:
        out.add_column(heading, justify="right")
    return out


def _step_cells(row: dict) -> list[str]:
    return [
        f"{row['n_envs']} x {row['threads']}",
        *(
            "-" if row[name] is None else f"{factor * row[name]:.{digits}f}"
            for name, factor, digits in (
                ("steps_per_second", 1, 0),
                ("raw_steps_per_second", 1, 0),
                ("ratio", 1, 2),
                ("overhead", 1e6, 1),
                ("overhead_ratio", 1, 2),
            )
        ),
    ]
