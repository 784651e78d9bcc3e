"""Closed-loop figures of a network on the three tasks."""

import numpy as np

from softrobot_env.control import neural
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.metrics import step_metrics
from softrobot_env.evaluation.run import run_episode
from softrobot_env.interfaces import Policy
from softrobot_env.learned.network import Network
from softrobot_env.robots import ARM

#: Tasks and step widths [m] of a trial.
CASES = (("swing", None), ("lshape", None), ("step", 0.05), ("step", 0.1), ("step", 0.2))


def trial(
    network: Network, moduli: tuple[float, ...] = (1.0,), duration: float | None = None
) -> dict[str, dict[str, float | str | None]]:
    """Largest and mean error [mm], and of steps overshoot [%] and settling time [s], by case.

    Args:
        network: To run.
        moduli: Factors on Young's modulus.
        duration: [s] of the episodes, the tasks' own unless given.
    """
    policy = neural.NeuralPolicy.of(ARM, network, neural.PERIOD)
    return trial_of(policy, moduli, duration)


def trial_of(
    policy: Policy, moduli: tuple[float, ...], duration: float | None = None
) -> dict[str, dict[str, float | str | None]]:
    """As `trial`, of any policy at the network's control period."""
    rows = {}
    for task, width in CASES:
        env = TrackingEnv(task, control_period=neural.PERIOD, preview=neural.PREVIEW)
        for factor in moduli:
            options = {} if width is None else {"step_width": width}
            if duration is not None:
                options["duration"] = duration
            if factor != 1:
                options |= {"vary": {"youngs_modulus": factor}}
            label = task if width is None else f"{task} {1e3 * width:g} mm"
            rows[f"{label}, E x {factor:g}"] = _row(env, policy, options)
    return rows


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
