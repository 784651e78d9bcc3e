"""Policies that close a gripper: by a schedule, and by the size of what it encloses."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from softrobot_env.control.gripper.calibration import FingerCalibration
from softrobot_env.control.gripper.size import SizeEstimator
from softrobot_env.core.interfaces import Observation
from softrobot_env.robots.gripper import Gripper

#: [s], in which the tension rises, and after which the fingers have calmed down.
RISE, CALM = 0.5, 0.7

#: Diameters [m] and the tensions [N] that hold bars of them.
_SIZES, _HOLDS = (0.045, 0.100), (20.0, 38.0)


@dataclass
class ScriptedGrip:
    """Closes all fingers to a tension, steadily, and keeps it.

    Attributes:
        gripper: The gripper.
        control_period: [s].
        tension: [N], at the end.
    """

    gripper: Gripper
    control_period: float
    tension: float = 30.0

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """As of `interfaces.Policy`; the state is the steps (n,) of each episode so far."""
        count = next(iter(observation.values())).shape[:-1]
        steps = np.zeros(count, dtype=int) if state is None else state["steps"]
        if episode_start is not None:
            steps = np.where(np.reshape(episode_start, steps.shape), 0, steps)
        known = {} if state is None else state
        steps = steps + 1
        tension, kept = self._tension(steps, observation, known)
        limits = self.gripper.tension_limits
        action = 2 * np.minimum(tension[..., None] / limits, 1.0) - 1
        return action.astype(np.float32), {"steps": steps, **kept}

    def _tension(
        self, steps: np.ndarray, observation: Observation, known: dict[str, np.ndarray]
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Tensions (...) [N] in steps (...) from 1 on, and what is to be remembered."""
        return self.tension * np.minimum(steps * self.control_period / RISE, 1.0), {}


@dataclass
class SizedGrip(ScriptedGrip):
    """Closes to the tension of an estimator, then to what holds a bar of the size it tells.

    Attributes:
        size: The estimator.
        sensors: How the curvatures follow from `sensors`; they are observed unless given.
    """

    size: SizeEstimator | None = None
    sensors: FingerCalibration | None = None

    def _tension(
        self, steps: np.ndarray, observation: Observation, known: dict[str, np.ndarray]
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """First as the estimator wants it; from `CALM` on by the size, told once."""
        if self.size is None:
            raise ValueError("a SizedGrip needs the size estimator of its gripper")
        curvature, kept = self._bends(steps, observation, known)
        time = steps * self.control_period
        first = self.size.tension * np.minimum(time / RISE, 1.0)
        told = known.get("diameter", np.full(time.shape, np.nan))
        told = np.where(time < CALM, np.nan, np.where(np.isnan(told), self.size(curvature), told))
        wanted = np.interp(np.nan_to_num(told), _SIZES, _HOLDS)
        share = np.clip((time - CALM) / 0.2, 0.0, 1.0)
        after = self.size.tension + share * (wanted - self.size.tension)
        return np.where(np.isnan(told), first, after), {"diameter": told, **kept}

    def _bends(
        self, steps: np.ndarray, observation: Observation, known: dict[str, np.ndarray]
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Curvatures (..., pieces) [1/m], and readings of straight fingers to be remembered."""
        if self.sensors is None:
            return observation["curvature"], {}
        now = observation["sensors"]
        straight = np.where(steps[..., None] == 1, now, known.get("straight", now))
        return self.sensors.curvature(now, straight), {"straight": straight}
