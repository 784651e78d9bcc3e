"""Policies that read tip or curvatures, computed from curvature sensors."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import read_artifact
from softrobot_env.sensing.reconstruction import TIP, Reconstruction, SensedShape

from .base import MEASURED, Controller, Held

_SENSORS, _VELOCITY = "sensors", "tip_velocity"


class SensedState(NamedTuple):
    """State between two calls.

    Attributes:
        inner: State of the policy.
        shape: Shape computed from the sensors.
        velocity: (axes,) [m/s], of the tip, from the difference of the last new readings.
        passed: [s] since the last new reading.
    """

    inner: Any
    shape: SensedShape
    velocity: ndarray
    passed: float = 0.0

    #: As in the policy.
    status = Held.status


class Sensed(Controller):
    """A policy that is shown values computed from calibrated sensors, with their delay.

    A reading that is not finite is ignored: the last one is kept. The sensors are read in every
    control period, even while the policy holds its action.
    """

    def __init__(self, policy: Controller, known: Reconstruction, control_period: float) -> None:
        """Wrap a policy, which may read fewer coordinates of the tip: the first ones.

        Args:
            policy: Any controller that reads quantities that the sensors measure.
            known: Calibration of the sensors.
            control_period: [s] between calls.

        Raises:
            ValueError: The policy reads nothing that the sensors measure, or something that they
                were not calibrated for; or the period is not positive.
        """
        check_argument("control_period", control_period, Positive)
        sizes = {name: found.weights.shape[1] for name, found in known.maps.items()}
        measured = ", ".join(sizes)
        sizes[_VELOCITY] = sizes[TIP]
        hidden = [name for name in policy.requires if name in sizes]
        blind = MEASURED & set(policy.requires) - set(hidden)
        if blind or not hidden:
            lacking = ", ".join(sorted(blind)) or f"none of {measured}"
            raise ValueError(
                f"feedback from sensors: {type(policy).__name__} reads {lacking}, the sensors were "
                f"calibrated to tell {measured}"
            )
        self._sizes = {name: policy.sizes.get(name, sizes[name]) for name in hidden}
        for name, size in self._sizes.items():
            if size > sizes[name] or (size < sizes[name] and name not in (TIP, _VELOCITY)):
                raise ValueError(
                    f"feedback from sensors: {type(policy).__name__} reads {size} entries of "
                    f"{name}, the sensors were calibrated to tell {sizes[name]}"
                )
        self._policy, self._known, self._period = policy, known, control_period
        self.requires = (_SENSORS, *(name for name in policy.requires if name not in hidden))
        self.hold, self.preview = policy.hold, policy.preview
        sizes = {name: size for name, size in policy.sizes.items() if name not in hidden}
        self.sizes = {**sizes, _SENSORS: known.size}

    def start(self, observation: Observation) -> SensedState:
        """Begin with a straight robot at rest; the policy has not started yet."""
        shape = self._known.begin(observation[_SENSORS])
        still = np.zeros_like(shape.reported[TIP])
        return SensedState(None, shape, still, -self._period)  # the first call is now

    def act(self, observation: Observation, state: SensedState) -> tuple[ndarray, SensedState]:
        """The action of the policy for the sensors' readings."""
        state = self._seen(observation[_SENSORS], state)
        seen = state.shape.reported | {_VELOCITY: state.velocity}
        shown = {name: seen[name][:size] for name, size in self._sizes.items()}
        action, inner = self._policy.predict({**observation, **shown}, state.inner)
        return action, state._replace(inner=inner)

    def _seen(self, reading: ndarray, state: SensedState) -> SensedState:
        passed = state.passed + self._period
        shape = self._known.update(state.shape, reading, passed)
        if shape is state.shape:
            return state._replace(passed=passed)
        velocity = (shape.reported[TIP] - state.shape.reported[TIP]) / passed
        return state._replace(shape=shape, velocity=velocity, passed=0.0)

    # The policy holds its actions itself.
    _go_on = _decide = act


def load_reconstruction(robot: RobotParams, path: str | Path | None = None) -> Reconstruction:
    """The calibration of a robot's sensors.

    Args:
        robot: As designed.
        path: Of the file; by default searched for, see `artifacts.find_artifact`.

    Raises:
        ValueError: The robot has no sensors, there is no calibration, or it is damaged or belongs
            to another robot; the message contains the command that makes it.
        FileNotFoundError: No such file.
    """
    if not robot.sensors:
        raise ValueError(
            f"feedback from sensors: robot {robot.name!r} carries none; give it [[sensor]] tables, "
            "spatial or tags"
        )
    data = read_artifact(robot, _SENSORS, path)
    with data.fitting():
        return Reconstruction.of(robot, data)
