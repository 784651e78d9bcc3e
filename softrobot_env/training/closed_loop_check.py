"""Closed-loop figures of a network on the three tasks."""

import numpy as np

from softrobot_env.control.arm import neural
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.metrics import step_metrics
from softrobot_env.evaluation.run import run_episode
from softrobot_env.interfaces import Policy
from softrobot_env.learned.network import Network
from softrobot_env.robots import ARM

#: Tasks and step widths [m] of a trial.
CASES = (("swing", None), ("lshape", None), ("step", 0.05), ("step", 0.1), ("step", 0.2))

Rows = dict[str, dict[str, float | str | None]]


def trial(
    network: Network,
    variations: tuple[dict[str, float], ...] = ({},),
    duration: float | None = None,
    reward: TrackingReward | None = None,
) -> Rows:
    """Largest and mean error [mm], and of steps overshoot [%] and settling time [s], by case.

    Args:
        network: To run.
        variations: Robots and disturbances, as in the option `vary` of `reset`.
        duration: [s] of the episodes, the tasks' own unless given.
        reward: Whose mean is told; the environments' default unless given.
    """
    policy = neural.NeuralPolicy(ARM, neural.PERIOD, network)
    return trial_of(policy, variations, duration, reward)


def trial_of(
    policy: Policy,
    variations: tuple[dict[str, float], ...],
    duration: float | None = None,
    reward: TrackingReward | None = None,
) -> Rows:
    """As `trial`, of any policy at the network's control period."""
    rows = {}
    for task, width in CASES:
        env = TrackingEnv(task, control_period=neural.PERIOD, preview=neural.PREVIEW, reward=reward)
        for vary in variations:
            options: dict[str, object] = {"vary": vary}
            if width is not None:
                options["step_width"] = width
            if duration is not None:
                options["duration"] = duration
            rows[_label(task, width, vary)] = _row(env, policy, options)
    return rows


def _label(task: str, width: float | None, vary: dict[str, float]) -> str:
    """For instance "step 50 mm, youngs_modulus 0.5"."""
    label = task if width is None else f"{task} {1e3 * width:g} mm"
    return ", ".join([label, *(f"{name} {value:g}" for name, value in vary.items())])


def _row(env: TrackingEnv, policy: Policy, options: dict) -> dict[str, float | str | None]:
    record = run_episode(env, policy, 0, options)
    row = {
        "max_mm": 1e3 * float(record.error.max()),
        "mean_mm": 1e3 * float(record.error.mean()),
        "reward": float(np.mean(record.reward[1:])),
        "failure": record.failure,
    }
    if "step_width" in options:
        found = step_metrics(record.time, record.tip, record.reference[-1])
        row |= {
            "overshoot_percent": None if found.overshoot is None else 100 * found.overshoot,
            "settling_s": found.settling_time,
            "steady_percent": 100 * found.steady_state_error,
        }
    return row
