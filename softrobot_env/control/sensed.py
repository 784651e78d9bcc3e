"""Policies that read the tip, where a curvature sensor is what tells of it."""

from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np

from softrobot_env.control.base import Controller
from softrobot_env.fields import Positive, check_argument
from softrobot_env.interfaces import Observation
from softrobot_env.sensing.estimation import BendFilter, LightModel

_TIP, _SENSORS = "tip_position", "sensors"


class SensedState(NamedTuple):
    """What the next call needs.

    Attributes:
        inner: State of the policy.
        felt: Bend, play and drift so far.
        status: Of the policy.
    """

    inner: Any
    felt: BendFilter
    status: str | None = None


class SensedTip(Controller):
    """A policy with the tip (2,) that a calibrated spatial sensor tells, as late as it reads.

    A reading that is not finite tells of no tip, which the policy has to cope with.
    """

    def __init__(self, policy: Controller, model: LightModel, control_period: float) -> None:
        """Put a sensor before a policy.

        Args:
            policy: Any controller that reads the tip in two coordinates.
            model: Of the sensor's specimen, see `sensing.estimation.calibrate`.
            control_period: [s] between calls.

        Raises:
            ValueError: The policy does not read the tip in two coordinates, or the period is not
                positive.
        """
        check_argument("control_period", control_period, Positive)
        if _TIP not in policy.requires:
            raise ValueError(f"{type(policy).__name__} does not read {_TIP}, so no sensor helps it")
        if policy.sizes.get(_TIP) != 2:
            raise ValueError(
                f"{type(policy).__name__} must read two coordinates of {_TIP}, x and y"
            )
        self._policy, self._model, self._period = policy, model, control_period
        self.requires = (*(name for name in policy.requires if name != _TIP), _SENSORS)
        self.hold, self.preview = policy.hold, policy.preview
        sizes = {name: size for name, size in policy.sizes.items() if name != _TIP}
        self.sizes = {**sizes, _SENSORS: len(model.gain)}

    def start(self, observation: Observation) -> SensedState:
        """Begin with a robot that was straight."""
        felt = BendFilter(self._model)
        return SensedState(self._policy.start({**observation, _TIP: felt.tip}), felt)

    def act(self, observation: Observation, state: SensedState) -> tuple[np.ndarray, SensedState]:
        """The action of the policy for the tip as sensed."""
        reading, felt, tip = observation[_SENSORS], deepcopy(state.felt), np.full(2, np.nan)
        if np.isfinite(reading).all():
            tip = felt.update(reading, self._period * self.hold)
        action, inner = self._policy.act({**observation, _TIP: tip}, state.inner)
        return action, SensedState(inner, felt, getattr(inner, "status", None))
