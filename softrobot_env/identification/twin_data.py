"""Quasi-static data of a twin, measured as on the real rig: by its servos and its camera.

Nothing is known of the twin but what `RigEnv` shows. The visit of the points is cut into a few
runs, each from the straight pose, which processes of their own can do at the same time. At
2.6 s a point, the 215 points of a network take nine minutes on a rig; the thesis tells five.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from softrobot_env.envs.rig import RigEnv
from softrobot_env.processes import worker_processes
from softrobot_env.robots import RIG
from softrobot_env.robots.twin import Twin
from softrobot_env.tasks import LONGEST
from softrobot_env.tasks.rig import RigTask, SetPoints

#: [s], of the commands to the servos and of the pictures that are used.
PERIOD = 0.02

_DITHER_FREQUENCY = 5.0  # Hz
_DITHERED = 0.8  # of the rest


@dataclass(frozen=True)
class Visit:
    """How a point is visited.

    Attributes:
        move: [s] to go there, by the smooth step 10 s^3 - 15 s^4 + 6 s^5 in the lengths.
        rest: [s] until the rig, which sways at 1.6 Hz with a fifth of the critical damping, is
            still.
        dither: [m], amplitude of a swing of all servos at once that dies away during the rest. It
            hardly bends the rig, but brings the horns to the middle of their play, from
            whichever side they came.
        pictures: Number of the camera's pictures that are averaged then, one per control period.
    """

    move: float = 1.2
    rest: float = 1.2
    dither: float = 0.6e-3
    pictures: int = 10


def measure(
    twin: Twin | int | None,
    lengths: np.ndarray,
    seed: int = 0,
    runs: int = 1,
    processes: int = 1,
    visit: Visit | None = None,
    progress: Callable[[int], None] | None = None,
) -> np.ndarray:
    """Outputs (n, 2) [m] of a twin at lengths (n, 3) [m], visited in turn.

    Args:
        twin: The rig, or the seed of one; see `RigEnv`.
        lengths: Pulled in.
        seed: Of the camera's noise.
        runs: Runs that the visit is cut into, at least as many as its length demands.
        processes: Runs at a time.
        visit: How to visit a point.
        progress: Called with the number of points visited in a run, or None; only in one process.

    Raises:
        ValueError: Lengths of another shape, beyond what the servos can pull in, or a number of
            runs or processes below one.
        RuntimeError: The simulation failed.
    """
    visit = visit or Visit()
    lengths = np.asarray(lengths, dtype=float)
    scale = RigEnv.length_scale
    if lengths.ndim != 2 or lengths.shape[1] != len(RIG.tendons) or not len(lengths):
        raise ValueError(f"need lengths of shape (n, {len(RIG.tendons)}), got {lengths.shape}")
    if not np.all(np.abs(lengths) <= scale):
        raise ValueError(f"lengths must lie within {scale:g} m, the servos' limit")
    if runs < 1 or processes < 1:
        raise ValueError(f"need one run and process or more, got {runs} and {processes}")
    jobs = list(_jobs(twin, lengths, seed, runs, visit))
    if processes == 1:
        return np.concatenate([_run(*job, progress) for job in jobs])
    with worker_processes(processes) as pool:
        return np.concatenate(list(pool.map(_run, *zip(*jobs, strict=True))))


_Job = tuple[Twin | int | None, np.ndarray, np.random.SeedSequence, Visit]


def _jobs(
    twin: Twin | int | None, lengths: np.ndarray, seed: int, runs: int, visit: Visit
) -> Iterator[_Job]:
    """Arguments of `_run`."""
    longest = int(LONGEST / visit_duration(visit, 1))
    runs = min(len(lengths), max(runs, -(-len(lengths) // longest)))
    for part, own in zip(
        np.array_split(lengths, runs), np.random.SeedSequence(seed).spawn(runs), strict=True
    ):
        yield twin, part, own, visit


def visit_duration(visit: Visit, points: int) -> float:
    """Time [s] that a run takes at most."""
    return points * (visit.move + visit.rest + PERIOD * visit.pictures + 3 * PERIOD)


def _run(
    twin: Twin | int | None,
    lengths: np.ndarray,
    seed: np.random.SeedSequence,
    visit: Visit,
    progress: Callable[[int], None] | None = None,
) -> np.ndarray:
    """Outputs (n, 2) [m] of a run from the straight pose."""
    env = started(twin, visit_duration(visit, len(lengths)), int(seed.generate_state(1)[0]))
    now, outputs = np.zeros(lengths.shape[1]), np.empty((len(lengths), 2))
    for i, there in enumerate(lengths / env.length_scale):
        outputs[i] = go(env, now, there, visit)
        now = there
        if progress is not None:
            progress(i + 1)
    return outputs


def started(twin: Twin | int | None, duration: float, seed: int) -> RigEnv:
    """A rig in the straight pose, with nothing to follow for `duration` [s]."""
    still = SetPoints(((0.0, 0.0, 0.0),), 1.0)
    env = RigEnv(
        RigTask("visit", RIG, still, duration),
        twin=twin,
        control_period=PERIOD,
        observe=("tip_position",),
        preview=(PERIOD,),
    )
    env.reset(seed=seed)
    return env


def go(env: RigEnv, here: np.ndarray, there: np.ndarray, visit: Visit) -> np.ndarray:
    """Output (2,) [m] after a move from one action to another (3,) and a rest."""
    share = np.linspace(0, 1, max(1, round(visit.move / PERIOD)) + 1)[1:]
    rise = share**3 * (10 - 15 * share + 6 * share**2)
    for action in (here + rise[:, None] * (there - here)).astype(np.float32):
        step(env, action)
    action = there.astype(np.float32)
    for swing in _dither(visit) / env.length_scale:
        step(env, np.clip(there + swing, -1, 1).astype(np.float32))
    return np.mean([step(env, action) for _ in range(visit.pictures)], axis=0)


def _dither(visit: Visit) -> np.ndarray:
    """Lengths (k,) [m] on top of those wanted, in the control periods of the rest."""
    time = PERIOD * np.arange(round(visit.rest / PERIOD))
    fading = np.maximum(0.0, 1 - time / (_DITHERED * visit.rest))
    return visit.dither * fading * np.sin(2 * np.pi * _DITHER_FREQUENCY * time)


def step(env: RigEnv, action: np.ndarray) -> np.ndarray:
    """The picture after a control period."""
    observation, _, failed, _, info = env.step(action)
    if failed:
        raise RuntimeError(info["failure"])
    return observation["tip_position"]
