"""Episodes of many grippers with random bars and fingers: sizes, holds, and what steps cost."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from time import perf_counter, process_time
from typing import Any

import numpy as np

from softrobot_env.benchmarks.gripper.rows import Hold, Size, Speed
from softrobot_env.control.gripper.policies import CALM, ScriptedGrip, SizedGrip
from softrobot_env.control.gripper.size import SizeEstimator, size_by_sensor
from softrobot_env.envs.gripper import VectorGripperEnv
from softrobot_env.robots import GRIPPERS
from softrobot_env.scene.timestep import TimestepWarning

GRIPPER = GRIPPERS["gripper"]

#: [N], tension at which sizes are told: most bars are then enclosed, and no tip has bent far.
TELLING = 16.0

#: Seeds of the examples that estimators are fitted to, of bars they are tested on, and of holds.
_FITTED, _TESTED, _HELD = 10_000, 20_000, 30_000

#: Grippers at once.
_TOGETHER = 50


@dataclass(frozen=True)
class Setting:
    """How finely grippers are simulated; None is as the rule for contacts has it."""

    pieces: int | None
    timestep: float | None

    def make(self, task: str, count: int, threads: int = 1) -> VectorGripperEnv:
        """So many grippers."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TimestepWarning)
            return VectorGripperEnv(
                count,
                task,
                pieces=self.pieces,
                timestep=self.timestep,
                threads=threads,
            )


#: By the rule; half as many pieces, quicker; and the quickest that tell held bars from lost ones.
RULE, MIDDLE, QUICK = Setting(None, None), Setting(12, 1e-3), Setting(6, 2e-3)


@dataclass(frozen=True)
class Played:
    """What came of episodes.

    Attributes:
        drawn: `info` at their starts.
        curvature: (n, pieces) [1/m], at the end.
        success, lost: (n,) bool.
        worst: (n,), largest error over what counts as success.
        tension: (n,) [N], mean of the fingers at the end.
        time_per_step: [s], of the processor, for one gripper.
    """

    drawn: dict[str, Any]
    curvature: np.ndarray
    success: np.ndarray
    lost: np.ndarray
    worst: np.ndarray
    tension: np.ndarray
    time_per_step: float


def played(
    setting: Setting, task: str, policy: Any, first: int, count: int, seconds: float | None = None
) -> Played:
    """Episodes of seeds from `first` on under a policy, whole ones unless so many seconds."""
    parts = [
        _played(setting, task, policy, first + k, min(_TOGETHER, count - k), seconds)
        for k in range(0, count, _TOGETHER)
    ]
    drawn = {n: np.concatenate([p.drawn[n] for p in parts]) for n in parts[0].drawn}
    names = ("curvature", "success", "lost", "worst", "tension")
    arrays = {n: np.concatenate([getattr(p, n) for p in parts]) for n in names}
    return Played(drawn, **arrays, time_per_step=float(np.mean([p.time_per_step for p in parts])))


def _played(
    setting: Setting, task: str, policy: Any, first: int, count: int, seconds: float | None
) -> Played:
    env = setting.make(task, count)
    observation, drawn = env.reset(seed=first)
    steps = env.max_episode_steps if seconds is None else round(seconds / env.control_period)
    lost, success, worst = np.zeros(count, bool), np.zeros(count, bool), np.zeros(count)
    state, first_ones, last = None, np.ones(count, bool), observation["curvature"]
    tension = observation["tendon_tension"].mean(axis=1)
    begin = process_time()
    for _ in range(steps):
        action, state = policy.predict(observation, state)
        observation, _, failed, over, info = env.step(action)
        worst = np.where(first_ones, np.maximum(worst, info["error"]), worst)
        lost |= failed & first_ones
        success |= info["success"] & first_ones
        last = np.where(first_ones[:, None], observation["curvature"], last)
        now = observation["tendon_tension"].mean(axis=1)
        tension = np.where(first_ones, now, tension)
        first_ones &= ~(failed | over)  # what follows are other episodes
    took = (process_time() - begin) / steps / count
    return Played(drawn, last, success, lost, worst, tension, took)


# ---------------------------------------------------------------- sizes


def told_bends(setting: Setting, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Curvatures (n, pieces) [1/m] of fingers round bars of diameters (n,) [m]."""
    policy = ScriptedGrip(GRIPPER, 0.02, TELLING)
    runs = played(setting, "enclose", policy, first, count, CALM)
    return runs.curvature, runs.drawn["diameter"]


def fitted_size(setting: Setting, count: int) -> SizeEstimator:
    """An estimator that is fitted to as many bars."""
    return SizeEstimator.fitted(GRIPPER, TELLING, *told_bends(setting, _FITTED, count))


def sizes(fit: Setting, test: Setting, examples: int, count: int) -> list[Size]:
    """Errors of sizes of bars gripped in one setting, by estimators fitted in another."""
    bends, diameters = told_bends(fit, _FITTED, examples)
    tested, truth = told_bends(test, _TESTED, count)
    pieces, fitted = _pieces(test), _pieces(fit)
    plain = size_by_sensor(GRIPPER, tested)
    rows = [_size("second sensor", pieces, None, 0.0, plain, truth)]
    robot = GRIPPER.fingers[0].robot
    per_degree = radians(1.0) / (robot.length / robot.pieces)
    for noise in (0.0, 1.0, 2.5):
        rng = np.random.default_rng(0)
        seen, other = (
            exact + noise * per_degree * rng.standard_normal(exact.shape)
            for exact in (bends, tested)
        )
        estimator = SizeEstimator.fitted(GRIPPER, TELLING, seen, diameters)
        rows.append(_size("polynomial", pieces, fitted, noise, estimator(other), truth))
    return rows


def _pieces(setting: Setting) -> int:
    scene = setting.make("enclose", 1).simulation.scene
    return next(iter(scene.parts.values())).scene.config.n_pieces


def _size(
    method: str,
    pieces: int,
    fitted: int | None,
    noise: float,
    told: np.ndarray,
    truth: np.ndarray,
) -> Size:
    errors = told - truth
    sizes = np.abs(errors)
    return Size(
        method=method,
        pieces=pieces,
        fitted=fitted,
        noise=noise,
        count=len(truth),
        mean=float(sizes.mean()),
        high=float(np.percentile(sizes, 95)),
        most=float(sizes.max()),
        diameters=tuple(truth.tolist()),
        errors=tuple(errors.tolist()),
    )


# ---------------------------------------------------------------- holds


def holds(setting: Setting, policy: str, count: int, examples: int) -> list[Hold]:
    """Episodes under a policy: "scripted 20 N" and the like, or "sized"."""
    made = ScriptedGrip(GRIPPER, 0.02, 20.0)
    if policy == "sized":
        made = SizedGrip(GRIPPER, 0.02, size=fitted_size(setting, examples))
    else:
        made.tension = float(policy.split()[1])
    runs = played(setting, "hold", made, _HELD, count)
    env = setting.make("hold", 1)
    return [
        Hold(
            policy=policy,
            pieces=_pieces(setting),
            timestep=env.simulation.scene.timestep.timestep,
            count=count,
            success=float(runs.success.mean()),
            lost=float(runs.lost.mean()),
            way=float(np.median(runs.worst) * env.task.within),
            tension=float(runs.tension.mean()),
            ms_per_step=1e3 * runs.time_per_step,
        )
    ]


# ---------------------------------------------------------------- speed


def speeds(task: str, settings: Sequence[Setting], many: int) -> list[Speed]:
    """What steps cost in some settings, the first of which is the rule's; errors against it."""
    rows, truth = [], None
    for setting in settings:
        env = setting.make(task, 1)
        runs = played(setting, task, ScriptedGrip(GRIPPER, 0.02, TELLING), _TESTED, 1, CALM)
        truth = runs.curvature if truth is None else truth
        robot = GRIPPER.fingers[0].robot
        off = np.degrees(np.abs(runs.curvature - truth).max()) * robot.length / robot.pieces
        rows.append(_speed(task, setting, env, 1 / runs.time_per_step, float(off)))
    setting = settings[-1]
    env = setting.make(task, many, threads=0)
    rows.append(_speed(task, setting, env, _rate(env), None))
    return rows


def _rate(env: VectorGripperEnv) -> float:
    """Steps per second of all, of a closing."""
    policy, state = ScriptedGrip(GRIPPER, env.control_period, TELLING), None
    observation, _ = env.reset(seed=_TESTED)
    steps = round(CALM / env.control_period)
    begin = perf_counter()
    for _ in range(steps):
        action, state = policy.predict(observation, state)
        observation, *_ = env.step(action)
    return steps * env.num_envs / (perf_counter() - begin)


def _speed(
    task: str, setting: Setting, env: VectorGripperEnv, rate: float, off: float | None
) -> Speed:
    scene = env.simulation.scene
    return Speed(
        task=task,
        pieces=next(iter(scene.parts.values())).scene.config.n_pieces,
        timestep=scene.timestep.timestep,
        rule=setting.timestep is None,
        count=env.num_envs,
        threads=env.simulation.threads,
        steps_per_s=rate,
        bend_error=off,
    )
