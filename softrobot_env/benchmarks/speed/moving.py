"""Steps per second of a moving arm, by the accuracy that is asked for, beside its true error."""

from time import perf_counter

import numpy as np

from softrobot_env.benchmarks.speed.rows import Row
from softrobot_env.envs.tracking import TrackingEnv

#: Shares of the length, and that of the truth.
ACCURACIES, _TRUTH = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4), 3e-6

#: Control periods of the motion, and for how many an action is held; its largest size.
_PERIODS, _HELD, _SIZE = 200, 10, 0.5


def run(quick: bool) -> list[Row]:
    """A row an accuracy; the time is the sum of the best of each part of the motion."""
    rng = np.random.default_rng(0)
    actions = rng.uniform(-_SIZE, _SIZE, (_PERIODS // _HELD, 3)).astype(np.float32)
    actions = np.repeat(actions, _HELD, axis=0)
    truth, _ = _motion(_env(_TRUTH), actions)
    chosen = ACCURACIES[2:3] if quick else ACCURACIES
    envs = [_env(accuracy) for accuracy in chosen]
    times = [[_times(env, actions) for env in envs] for _ in range(5 if quick else 40)]
    best = np.min(times, axis=0).mean(axis=1).tolist()
    return [
        _row(accuracy, seconds, truth, *_motion(env, actions))
        for env, accuracy, seconds in zip(envs, chosen, best, strict=True)
    ]


def _env(accuracy: float) -> TrackingEnv:
    return TrackingEnv("step", accuracy=f"{100 * accuracy:g}%")


def _times(env: TrackingEnv, actions: np.ndarray) -> list[float]:
    """[s] of a step in each part of the motion, in which the action is held."""
    env.reset(seed=0)
    times = []
    for part in actions.reshape(-1, _HELD, actions.shape[1]):
        begin = perf_counter()
        for action in part:
            env.step(action)
        times.append((perf_counter() - begin) / _HELD)
    return times


def _motion(env: TrackingEnv, actions: np.ndarray) -> tuple[np.ndarray, float]:
    """Tips (periods, k) [m], and the estimate [m] of their error."""
    env.reset(seed=0)
    tips = []
    for action in actions:
        observation, *_, info = env.step(action)
        tips.append(observation["tip_position"].copy())
    return np.array(tips), info["integration_error"]


def _row(
    accuracy: float, seconds: float, truth: np.ndarray, tips: np.ndarray, estimate: float
) -> Row:
    error = np.linalg.norm(tips - truth, axis=1).max()
    told = {"accuracy": accuracy, "error": float(error), "estimate": float(estimate)}
    speed = {"steps_per_second": 1 / seconds, "seconds": seconds}
    return Row("moving", "arm", 1, 1, **speed, **told)
