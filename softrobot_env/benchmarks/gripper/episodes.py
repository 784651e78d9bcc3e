"""Episodes of many grippers with random bars and fingers: sizes, holds, and what steps cost."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from time import perf_counter, process_time
from typing import Any

import numpy as np

from softrobot_env.benchmarks.gripper.rows import Outcome, Size, Speed
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

#: Grippers at once, and those of which a policy learns.
_TOGETHER, _LEARNERS = 50, 16

#: [s], control period.
PERIOD = 0.02

#: How what learns sees grippers.
VIEW: dict[str, Any] = {
    "observe": ("curvature", "tendon_tension", "contact", "previous_action"),
    "observe_as": "vector",
}


@dataclass(frozen=True)
class Setting:
    """How finely grippers are simulated; None is as the rule for contacts has it."""

    pieces: int | None
    timestep: float | None

    def make(self, task: str, count: int, threads: int = 1, **options: Any) -> VectorGripperEnv:
        """So many grippers, with other options of the environment."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TimestepWarning)
            return VectorGripperEnv(
                count,
                task,
                pieces=self.pieces,
                timestep=self.timestep,
                threads=threads,
                **options,
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
        worst: (n,), error over what counts as success: of holds the largest, else the last.
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
    setting: Setting,
    task: str,
    policy: Any,
    first: int,
    count: int,
    seconds: float | None = None,
    **options: Any,
) -> Played:
    """Episodes of seeds from `first` on under a policy, whole ones unless so many seconds.

    Options are those of the environment.
    """
    parts = [
        _played(
            setting.make(task, min(_TOGETHER, count - k), **options), policy, first + k, seconds
        )
        for k in range(0, count, _TOGETHER)
    ]
    drawn = {n: np.concatenate([p.drawn[n] for p in parts]) for n in parts[0].drawn}
    names = ("curvature", "success", "lost", "worst", "tension")
    arrays = {n: np.concatenate([getattr(p, n) for p in parts]) for n in names}
    return Played(drawn, **arrays, time_per_step=float(np.mean([p.time_per_step for p in parts])))


def _played(env: VectorGripperEnv, policy: Any, first: int, seconds: float | None) -> Played:
    count = env.num_envs
    observation, drawn = env.reset(seed=first)
    steps = env.max_episode_steps if seconds is None else round(seconds / env.control_period)
    lost, success, worst = np.zeros(count, bool), np.zeros(count, bool), np.zeros(count)
    simulation, holding = env.simulation, env.task.free
    state, first_ones = None, np.ones(count, bool)
    last, tension = simulation.curvature, np.zeros(count)
    begin = process_time()
    for _ in range(steps):
        action, state = policy.predict(observation, state, deterministic=True)
        observation, _, failed, over, info = env.step(action)
        error = np.maximum(worst, info["error"]) if holding else info["error"]
        worst = np.where(first_ones, error, worst)
        lost |= failed & first_ones
        success |= info["success"] & first_ones
        last = np.where(first_ones[:, None], simulation.curvature, last)
        tension = np.where(first_ones, simulation.ctrl.mean(axis=1), tension)
        first_ones &= ~(failed | over)  # what follows are other episodes
    took = (process_time() - begin) / steps / count
    return Played(drawn, last, success, lost, worst, tension, took)


# ---------------------------------------------------------------- sizes


def told_bends(setting: Setting, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Curvatures (n, pieces) [1/m] of fingers round bars of diameters (n,) [m]."""
    policy = ScriptedGrip(GRIPPER, PERIOD, TELLING)
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


# ---------------------------------------------------------------- outcomes


def outcomes(
    setting: Setting, task: str, policy: str, count: int, examples: int = 0
) -> list[Outcome]:
    """Episodes under a policy: "scripted 20 N" and the like, "sized", or "ppo".

    Args:
        setting: How finely grippers are simulated.
        task: Name of the task.
        policy: The policy.
        count: Number of episodes.
        examples: Bars to which "sized" is fitted, or steps with which "ppo" is trained.
    """
    if policy == "ppo":
        made, how = learned(task, examples), VIEW
    elif policy == "sized":
        made, how = SizedGrip(GRIPPER, PERIOD, size=fitted_size(setting, examples)), {}
    else:
        made, how = ScriptedGrip(GRIPPER, PERIOD, float(policy.split()[1])), {}
    runs = played(setting, task, made, _HELD, count, **how)
    timestep = setting.make(task, 1).simulation.scene.timestep.timestep
    return [
        Outcome(
            task=task,
            policy=f"ppo, {examples} steps" if policy == "ppo" else policy,
            pieces=_pieces(setting),
            timestep=timestep,
            count=count,
            success=float(runs.success.mean()),
            lost=float(runs.lost.mean()),
            error=float(np.median(runs.worst)),
            tension=float(runs.tension.mean()),
            ms_per_step=1e3 * runs.time_per_step,
        )
    ]


def learned(task: str, steps: int) -> Any:
    """A policy of stable-baselines3's PPO, trained in the quickest setting."""
    import torch
    from stable_baselines3 import PPO

    from softrobot_env.training.vec_env import TrackingVecEnv

    torch.set_num_threads(1)
    env = TrackingVecEnv([QUICK.make(task, _LEARNERS, autoreset_mode="SameStep", **VIEW)])
    env.seed(0)
    model = PPO(
        "MlpPolicy",
        env,
        n_steps=256,
        batch_size=512,
        gamma=0.98,
        learning_rate=1e-3,
        policy_kwargs={"log_std_init": -1.0},
        seed=0,
        device="cpu",
    )
    return model.learn(steps)


# ---------------------------------------------------------------- speed


def speeds(task: str, settings: Sequence[Setting], many: int) -> list[Speed]:
    """What steps cost in some settings, the first of which is the rule's; errors against it."""
    rows, truth = [], None
    for setting in settings:
        env = setting.make(task, 1)
        runs = played(setting, task, ScriptedGrip(GRIPPER, PERIOD, TELLING), _TESTED, 1, CALM)
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
