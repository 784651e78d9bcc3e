"""What plans on a learned model need of an environment, without loading the models."""

from pathlib import Path
from typing import Any

import numpy as np

from softrobot_env.core.artifacts import read_arrays
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import read_artifact

#: Name of the file of a learned model.
ARTIFACT = "ssm"

#: Samples of a plan, and times of the preview.
SAMPLES, _KNOTS = 60, 16


def is_reduced_model(path: Path) -> bool:
    """Whether a file of arrays holds a learned model; raises ValueError if it is damaged."""
    return "tangent" in read_arrays(path)


def ssm_environment(robot: RobotParams, weights: Path | None = None) -> dict[str, Any]:
    """The period of a robot's model, and the preview; empty if no model was learned."""
    try:
        data = read_artifact(robot, ARTIFACT, weights)
        with data.fitting():
            period, lag = float(data["period"]), int(data["lag"])
            return {"control_period": period, "preview": preview_times(period, lag)}
    except ValueError:
        return {}  # `make_policy` says what is missing


def preview_times(period: float, lag: int) -> tuple[float, ...]:
    """Times [s] ahead at which a plan needs the reference.

    Args:
        period: [s] of a sample of the model.
        lag: Samples by which inputs act late.
    """
    shares = np.linspace(0, 1, _KNOTS + 1)[1:] ** 1.5
    steps = np.unique(np.round(shares * (lag + SAMPLES)).astype(int))
    return tuple(round(float(step * period), 9) for step in steps if step > 0)
