"""Lengths pulled in at the rig's servos, at rest and over time."""

from collections.abc import Callable

import numpy as np

from softrobot_env.benchmarks.accuracy.rows import DURATION
from softrobot_env.robots import RIG
from softrobot_env.scene.config import TipSensors

#: Lengths (3,) [m] of the static cases. In the last one a tendon hangs slack.
STATIC: dict[str, tuple[float, float, float]] = {
    "rig_pull_10mm": (10e-3, 0.0, 0.0),
    "rig_pull_20mm": (20e-3, 0.0, 0.0),
    "rig_general": (12e-3, 6e-3, 0.0),
    "rig_slack": (12e-3, 4e-3, -25e-3),
}

STEP, CIRCLE = "rig_length_step", "rig_fast_circle"

#: [s] between compared instants: a control period of the rig's environments.
PERIOD = 0.02

#: The step pulls in one tendon [m]. The circle pulls them in and lets them out in turn by as much,
#: once a second after the first one, which takes the tip round at about 0.6 m/s.
_STEP, _CIRCLE, _LAP, _RISE = 10e-3, 7e-3, 1.0, 1.0


def step(t: float | np.ndarray) -> np.ndarray:
    """Lengths (..., 3) [m] at times (...) [s] of one tendon that is pulled in at once."""
    return np.ones(np.shape(t))[..., None] * np.array([_STEP, 0.0, 0.0])


def circle(t: float | np.ndarray) -> np.ndarray:
    """Lengths (..., 3) [m] at times (...) [s] that lead the tip to a circle and round on it."""
    t = np.asarray(t)[..., None]
    size = _CIRCLE * np.sin(np.pi / 2 * np.minimum(t / _RISE, 1)) ** 2
    return size * np.cos(2 * np.pi * (t / _LAP - np.arange(3) / 3))


MOTIONS: dict[str, Callable[[float | np.ndarray], np.ndarray]] = {STEP: step, CIRCLE: circle}

CASES = (*STATIC, *MOTIONS)


def sample_times() -> np.ndarray:
    """Instants [s] at which tips are compared."""
    return np.linspace(0, DURATION, round(DURATION / PERIOD) + 1)


#: The robot of all cases, and its MuJoCo chain.
ROBOT = RIG
CHAIN = {
    "actuation": "length",
    "bending": "spatial",
    "control_period": PERIOD,
    "sensors": (TipSensors(),),
}
