"""P and PI feedback that shifts the reference of another policy (thesis sec. 6.1)."""

from typing import Any, NamedTuple

import numpy as np

from softrobot_env.control.base import Controller, usable
from softrobot_env.control.status import NOT_FINITE, REASONS
from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import NotNegative, Positive, check_argument

_TIP, _NOT_FINITE = "tip_position", REASONS[NOT_FINITE]


class ReferenceState(NamedTuple):
    """What the next call needs.

    Attributes:
        inner: State of the policy whose reference is shifted.
        integral: (k,) [m s], of the tip's error.
        sent: (n, k) [m], references whose tip was not seen yet, oldest first.
        status: Of that policy, or that the tip is not seen.
        begun: Whether the tip was seen before.
    """

    inner: Any
    integral: np.ndarray
    sent: np.ndarray
    status: str | None = None
    begun: bool = False


class ReferenceFeedback(Controller):
    """Another policy, asked for z_ref + u_C, u_C = K_P e + K_I int e dt, (6.1) to (6.3).

    The error e is that of the time when the tip was seen, z_ref(t - d) - z. A tip that is not
    finite counts as where it should be; before one was seen, the action in force is kept.
    """

    def __init__(
        self,
        policy: Controller,
        control_period: float,
        proportional: float,
        integral: float,
        tip_delay: float = 0.0,
    ) -> None:
        """Put feedback around a policy.

        Args:
            policy: Any controller that reads a reference.
            control_period: [s] between calls.
            proportional: K_P [1].
            integral: K_I [1/s].
            tip_delay: d [s], rounded to whole control periods.

        Raises:
            ValueError: A gain or the delay is negative, the period not positive, or the policy does
                not say how many coordinates of a reference it reads.
        """
        check_argument("control_period", control_period, Positive)
        check_argument("proportional", proportional, NotNegative)
        check_argument("integral", integral, NotNegative)
        check_argument("tip_delay", tip_delay, NotNegative)
        if "reference" not in policy.sizes:
            raise ValueError(f"{type(policy).__name__} does not say the size of its reference")
        self._late = round(tip_delay / control_period / policy.hold)
        self._policy, self._period = policy, control_period
        self._proportional, self._integral = proportional, integral
        self.requires = tuple(dict.fromkeys((*policy.requires, _TIP, "previous_action")))
        self.hold, self.preview = policy.hold, policy.preview
        self.sizes = {_TIP: policy.sizes["reference"], **policy.sizes}

    def start(self, observation: Observation) -> ReferenceState:
        """Begin with no error behind."""
        reference = usable(np.array(observation["reference"], dtype=float))
        sent = np.tile(reference, (self._late, 1))
        return ReferenceState(self._policy.start(observation), np.zeros_like(reference), sent)

    def act(
        self, observation: Observation, state: ReferenceState
    ) -> tuple[np.ndarray, ReferenceState]:
        """The action of the policy for the shifted reference."""
        reference, tip = observation["reference"], observation[_TIP]
        is_seen = bool(np.isfinite(tip).all())
        if not (is_seen or state.begun):
            kept = np.clip(usable(observation["previous_action"]), -1.0, 1.0)
            return kept, state._replace(status=_NOT_FINITE)
        sent = np.vstack([state.sent, np.where(np.isfinite(reference), reference, usable(tip))])
        error = sent[0] - tip if is_seen else np.zeros(len(tip))
        integral = state.integral + self._period * self.hold * error
        shift = self._proportional * error + self._integral * integral
        shifted = {**observation, "reference": reference + shift}
        action, inner = self._policy.act(shifted, state.inner)
        status = getattr(inner, "status", None) if is_seen else _NOT_FINITE
        return action, ReferenceState(inner, integral, sent[1:], status, True)
