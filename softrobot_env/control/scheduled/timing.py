"""When laws of any robot decide and see the reference, in units of its first mode's period."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import model_scene

#: Control periods [s] to choose from: the longest that fits this many times into the first mode's
#: period.
_PERIODS, _PER_MODE = (1e-3, 2e-3, 5e-3, 1e-2), 250

#: Preview times, in control periods, up to this share of the first mode's period.
_KNOTS = (1, 2, 4, 7, 11, 16, 23, 32, 45, 60, 80, 105, 150, 200, 270)
_HORIZON = 0.25


class Timing(NamedTuple):
    """Times of a robot.

    Attributes:
        first: [s], period of its first mode.
        period: [s] between decisions.
        knots: (k,) [s], times ahead at which the reference is seen; the first is one period.
        nodes: (c,) [s], nodes of the piecewise linear planned actions; the first is after one
            period, at the end of the action that is decided now.
    """

    first: float
    period: float
    knots: tuple[float, ...]
    nodes: tuple[float, ...]

    @property
    def environment(self) -> dict[str, Any]:
        """The control period and preview that a law needs of an environment."""
        return {"control_period": self.period, "preview": self.knots}


@lru_cache(maxsize=64)
def timing_of(robot: RobotParams) -> Timing:
    """The times of a robot; ValueError or EquilibriumError if it has no first mode at rest."""
    first = build_scene(model_scene(robot)).timestep.first_period
    period = max((p for p in _PERIODS if _PER_MODE * p <= first), default=_PERIODS[0])
    return Timing(first, period, knots_until(_HORIZON, first, period), (period,))


def knots_until(share: float, first: float, period: float) -> tuple[float, ...]:
    """Preview times [s] up to a share of the first mode's period, at least three."""
    most = max(share * first, _KNOTS[2] * period)
    knots = np.round([k * period for k in _KNOTS if k * period <= most], 9)
    return tuple(knots.tolist())


def lqi(robot: RobotParams) -> dict[str, Any]:
    """What `lqi` and `mpc` need of an environment: the control period."""
    return {"control_period": timing_of(robot).period}


def lq_preview(robot: RobotParams) -> dict[str, Any]:
    """What `lq_preview` needs of an environment: the control period, and preview."""
    return timing_of(robot).environment
