"""Episodes of many grippers with random bars and fingers: sizes, holds, and what steps cost."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import Any

import numpy as np

from softrobot_env.benchmarks.gripper.rows import Outcome, Shape, Size, Speed
from softrobot_env.control.gripper.calibration import FingerCalibration, calibrated
from softrobot_env.control.gripper.policies import CALM, RISE, ScriptedGrip, SizedGrip
from softrobot_env.control.gripper.size import SizeEstimator, size_by_sensor
from softrobot_env.envs.gripper import VectorGripperEnv
from softrobot_env.envs.rendering.gripper import finger_shapes
from softrobot_env.robots import GRIPPERS

GRIPPER = GRIPPERS["gripper"]

#: [N], tension at which sizes are told: most bars are then enclosed, and no tip has bent far.
TELLING = 16.0

#: Seeds of the examples that estimators are fitted to, of bars they are tested on, and of holds.
_FITTED, _TESTED, _HELD = 10_000, 20_000, 30_000

#: Grippers at once, and those of which a policy learns.
_TOGETHER, _LEARNERS = 50, 16

#: What is added to seeds for the noise while sensors are calibrated.
_CALIBRATED = 5_000_000

#: [s], control period.
PERIOD = 0.02

#: Bars on which finenesses are compared, and tension [N] and time [s] of that.
_COMPARED, _SQUEEZE, _CLOSED = 8, 25.0, 1.0

#: Makes a policy for environments of seeds from some number on.
Policies = Callable[[VectorGripperEnv, int], Any]

#: How what learns sees grippers.
VIEW: dict[str, Any] = {
    "observe": ("curvature", "tendon_tension", "contact", "previous_action"),
    "observe_as": "vector",
}


def make(fineness: str, task: str, count: int, threads: int = 1, **options: Any) -> Any:
    """So many grippers, with other options of the environment."""
    return VectorGripperEnv(count, task, fineness=fineness, threads=threads, **options)


@dataclass(frozen=True)
class Played:
    """What came of episodes.

    Attributes:
        drawn: `info` at their starts.
        success, lost: (n,) bool.
        worst: (n,), error over what counts as success: of holds the largest, else the last.
        tension: (n,) [N], mean of the fingers at the end.
        time_per_step: [s], of the processor, for one gripper.
    """

    drawn: dict[str, Any]
    success: np.ndarray
    lost: np.ndarray
    worst: np.ndarray
    tension: np.ndarray
    time_per_step: float


def played(
    fineness: str, task: str, policy: Policies, first: int, count: int, **options: Any
) -> Played:
    """Episodes of seeds from `first` on.

    Args:
        fineness: How finely grippers are simulated.
        task: Name of the task.
        policy: Makes a policy for environments, those of seeds from some number on.
        first, count: Seeds.
        **options: Of the environment.
    """
    parts = []
    for k in range(0, count, _TOGETHER):
        env = make(fineness, task, min(_TOGETHER, count - k), **options)
        parts.append(_played(env, policy(env, first + k), first + k))
    drawn = {n: np.concatenate([p.drawn[n] for p in parts]) for n in parts[0].drawn}
    names = ("success", "lost", "worst", "tension")
    arrays = {n: np.concatenate([getattr(p, n) for p in parts]) for n in names}
    return Played(drawn, **arrays, time_per_step=float(np.mean([p.time_per_step for p in parts])))


def _played(env: VectorGripperEnv, policy: Any, first: int) -> Played:
    count = env.num_envs
    observation, drawn = env.reset(seed=first)
    steps = env.max_episode_steps
    lost, success, worst = np.zeros(count, bool), np.zeros(count, bool), np.zeros(count)
    simulation, holding = env.simulation, env.task.free
    state, first_ones = None, np.ones(count, bool)
    tension = np.zeros(count)
    begin = process_time()
    for _ in range(steps):
        action, state = policy.predict(observation, state, deterministic=True)
        observation, _, failed, over, info = env.step(action)
        error = np.maximum(worst, info["error"]) if holding else info["error"]
        worst = np.where(first_ones, error, worst)
        lost |= failed & first_ones
        success |= info["success"] & first_ones
        tension = np.where(first_ones, simulation.ctrl.mean(axis=1), tension)
        first_ones &= ~(failed | over)  # what follows are other episodes
    took = (process_time() - begin) / steps / count
    return Played(drawn, success, lost, worst, tension, took)


# ---------------------------------------------------------------- sizes


@dataclass(frozen=True)
class Told:
    """What is told of the bends (n, pieces) [1/m] round bars of diameters (n,) [m], and the truth.

    Attributes:
        bends: By the sensors, or exact.
        exact: True means over the pieces.
        qpos: (n, nq), postures.
    """

    bends: np.ndarray
    exact: np.ndarray
    qpos: np.ndarray
    diameters: np.ndarray


def told_bends(fineness: str, task: str, first: int, count: int, errors: float | None) -> Told:
    """Closings on bars of seeds from `first` on, clamped or free as in a task.

    With sensors each gripper is calibrated first; their imperfections are `errors` times the usual.
    """
    parts = [
        _told_bends(fineness, task, first + k, min(_TOGETHER, count - k), errors)
        for k in range(0, count, _TOGETHER)
    ]
    names = ("bends", "exact", "qpos", "diameters")
    return Told(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _told_bends(fineness: str, task: str, first: int, count: int, errors: float | None) -> Told:
    observe = ("tendon_tension",) if errors is None else ("sensors",)
    env = make(fineness, task, count, observe=observe)
    own: dict[str, Any] = {} if errors is None else {"sensor_errors": errors}
    calibration = None if errors is None else calibrated_to(env, fineness, first, own)
    start, info = env.reset(seed=first, options=own)
    policy, state, seen = ScriptedGrip(GRIPPER, PERIOD, TELLING), None, start
    for _ in range(round(CALM / PERIOD)):
        action, state = policy.predict(seen, state)
        seen, *_ = env.step(action)
    exact = env.simulation.curvature
    bends = exact
    if calibration is not None:
        bends = calibration.curvature(seen["sensors"], start["sensors"])
    return Told(bends, exact, env.simulation.qpos.copy(), info["diameter"])


def calibrated_to(
    env: VectorGripperEnv, fineness: str, first: int, own: dict[str, Any]
) -> FingerCalibration:
    """Calibrate the grippers that environments draw of seeds from `first` on, with other noise."""
    _, drawn = env.reset(seed=first, options=own)
    specimens = {name: drawn[name] for name in ("modulus", "arm", "sensor_errors", "specimen")}
    clamped = make(fineness, "enclose", env.num_envs, observe=("sensors",))
    return calibrated(clamped, specimens, _CALIBRATED + first)


def fitted_size(fineness: str, task: str, count: int, errors: float | None = None) -> SizeEstimator:
    """An estimator that is fitted to as many bars."""
    told = told_bends(fineness, task, _FITTED, count, errors)
    return SizeEstimator.fitted(GRIPPER, TELLING, told.bends, told.diameters)


def sizes(
    fit: str, test: str, task: str, examples: int, count: int, scales: Sequence[float | None]
) -> list[Size | Shape]:
    """Errors of sizes of bars gripped in one fineness, by estimators fitted in another.

    Args:
        fit, test: The two.
        task: Whether bars are clamped or free.
        examples, count: Bars that are fitted to, and tested on.
        scales: Of the sensors' imperfections; None for exact bends.
    """
    pieces, fitted = _pieces(test), _pieces(fit)
    rows: list[Size | Shape] = []
    for errors in scales:
        told = told_bends(test, task, _TESTED, count, errors)
        about = task, pieces
        if errors is None:
            plain = size_by_sensor(GRIPPER, told.exact)
            rows.append(_size("second sensor", *about, None, None, plain, told.diameters))
        found = fitted_size(fit, task, examples, errors)(told.bends)
        rows.append(_size("polynomial", *about, fitted, errors, found, told.diameters))
        rows.append(_shape(test, task, pieces, errors, told))
    return rows


def _shape(fineness: str, task: str, pieces: int, errors: float | None, told: Told) -> Shape:
    robot = GRIPPER.fingers[0].robot
    bend = np.degrees(np.abs(told.bends - told.exact)) * robot.length / robot.pieces
    parts = make(fineness, task, 1).simulation.scene.parts
    true = np.stack([part.tip(told.qpos) for part in parts.values()], axis=1)
    tips = [[points[-1] for points in finger_shapes(GRIPPER, row)] for row in told.bends]
    away = np.linalg.norm(np.array(tips) - true, axis=2)
    return Shape(task, pieces, errors, away.size, *_spread(bend), *_spread(away))


def _spread(values: np.ndarray) -> tuple[float, float, float]:
    """Mean, 95th percentile and largest."""
    return float(values.mean()), float(np.percentile(values, 95)), float(values.max())


def _pieces(fineness: str) -> int:
    scene = make(fineness, "enclose", 1).simulation.scene
    return next(iter(scene.parts.values())).scene.config.n_pieces


def _size(
    method: str,
    task: str,
    pieces: int,
    fitted: int | None,
    errors: float | None,
    told: np.ndarray,
    truth: np.ndarray,
) -> Size:
    off = told - truth
    spread = _spread(np.abs(off))
    drawn = tuple(truth.tolist()), tuple(off.tolist())
    return Size(method, task, pieces, fitted, errors, len(truth), *spread, *drawn)


# ---------------------------------------------------------------- outcomes


def outcomes(fineness: str, task: str, policy: str, count: int, examples: int = 0) -> list[Outcome]:
    """Episodes under a policy: "scripted 20 N" and the like, "sized" by the sensors, or "ppo".

    Args:
        fineness: How finely grippers are simulated.
        task: Name of the task.
        policy: The policy.
        count: Number of episodes.
        examples: Bars to which "sized" is fitted, or steps with which "ppo" is trained.
    """
    how: dict[str, Any] = {}
    if policy == "ppo":
        model, how = learned(task, examples), VIEW
    elif policy == "sized":
        size, how = fitted_size("quick", task, examples, 1.0), {"observe": ("sensors",)}

    def made(env: VectorGripperEnv, first: int) -> Any:
        if policy == "ppo":
            return model
        if policy == "sized":
            known = calibrated_to(env, fineness, first, {})
            return SizedGrip(GRIPPER, PERIOD, size=size, sensors=known)
        return ScriptedGrip(GRIPPER, PERIOD, float(policy.split()[1]))

    runs = played(fineness, task, made, _HELD, count, **how)
    timestep = make(fineness, task, 1).simulation.scene.timestep.timestep
    return [
        Outcome(
            task=task,
            policy=f"ppo, {examples} steps" if policy == "ppo" else policy,
            pieces=_pieces(fineness),
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
    """A policy of stable-baselines3's PPO, trained with the quick fineness."""
    import torch
    from stable_baselines3 import PPO

    from softrobot_env.training.vec_env import TrackingVecEnv

    torch.set_num_threads(1)
    env = TrackingVecEnv([make("quick", task, _LEARNERS, autoreset_mode="SameStep", **VIEW)])
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


def speeds(task: str, many: int, threads: Sequence[int]) -> list[Speed]:
    """What steps cost by the rule and quickly, one gripper or many on some threads."""
    truth = _bends("rule", task)
    rows = []
    for fineness in ("rule", "quick"):
        off = np.degrees(np.abs(_bends(fineness, task) - truth)) * GRIPPER.fingers[0].robot.length
        off /= GRIPPER.fingers[0].robot.pieces
        errors = float(off.mean()), float(off.max())
        rows.append(_speed(fineness, task, 1, 1, errors))
    return rows + [_speed("quick", task, many, count, (None, None)) for count in threads]


def _bends(fineness: str, task: str) -> np.ndarray:
    """Curvatures (steps, n, pieces) [1/m] of grippers that close, with neither pull nor shake."""
    env = make(fineness, task, _COMPARED)
    env.reset(seed=_TESTED, options={"pull": 0.0, "shake": 0.0})
    bends = []
    for k in range(round(_CLOSED / PERIOD)):
        env.step(_closing(_COMPARED, k))
        bends.append(env.simulation.curvature)
    return np.stack(bends)


def _closing(count: int, k: int) -> np.ndarray:
    """Action k (n, inputs) of grippers that close and then hold."""
    tension = _SQUEEZE * min(1.0, (k + 1) * PERIOD / RISE)
    return np.tile((2 * tension / GRIPPER.tension_limits - 1).astype(np.float32), (count, 1))


def _rate(fineness: str, task: str, count: int, threads: int) -> float:
    """Steps per second of all grippers, over an episode: they close, hold, are pulled and shaken.

    Of processor time on one thread, which a busy machine does not change, else of wall time.
    """
    env = make(fineness, task, count, threads)
    clock = process_time if threads == 1 else perf_counter
    env.reset(seed=_TESTED)
    took, steps = 0.0, env.max_episode_steps
    for k in range(steps):
        action = _closing(count, k)
        begin = clock()
        env.step(action)
        took += clock() - begin
    return steps * count / took


def _speed(
    fineness: str,
    task: str,
    count: int,
    threads: int,
    errors: tuple[float | None, float | None],
) -> Speed:
    timestep = make(fineness, task, 1).simulation.scene.timestep.timestep
    rate = _rate(fineness, task, count, threads)
    return Speed(task, _pieces(fineness), timestep, fineness, count, threads, rate, *errors)
