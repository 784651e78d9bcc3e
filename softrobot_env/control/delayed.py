"""Policies whose commands arrive late by a known time: they see the robot as it then will be."""

from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.robots import RobotParams

from .base import Controller, Held, usable
from .observers import rate_observer

_REFERENCE = frozenset({"reference", "reference_preview"})

#: What is predicted, or known.
_PREDICTED = frozenset({"curvature", "curvature_rate", "tip_position", "previous_action"})


class PredictedState(NamedTuple):
    """What the next call needs.

    Attributes:
        inner: State of the policy.
        estimate: (4, n), see `RateObserver`; None before the first call.
        applied: (m,) [1], action in force since the last call.
        sent: (k, m) [1], actions that are yet to arrive, the oldest first.
    """

    inner: Any
    estimate: ndarray | None
    applied: ndarray
    sent: ndarray

    #: As of the policy.
    status = Held.status


class DelayCompensation(Controller):
    """A policy that is shown its robot, and the reference, at the time when its action arrives.

    The model of an observer predicts curvatures and rates over the delay, under the actions that
    are on their way, and with the unexplained forces that the observer found; the tip moves with
    them. The environment shows the reference from then on.
    """

    def __init__(
        self, policy: Controller, robot: RobotParams, control_period: float, delay: float
    ) -> None:
        """Let a policy act ahead.

        Args:
            policy: Any controller of a robot driven by tension that reads nothing but curvatures,
                their rates, the tip's position, the reference, its preview and the action in force.
            robot: Nominal robot.
            control_period: [s] between calls.
            delay: [s] between a call and the time when its action is applied.

        Raises:
            ValueError: Another policy or robot, or a delay that is no multiple of the control
                period.
        """
        check_argument("control_period", control_period, Positive)
        check_argument("delay", delay, Positive)
        name, steps = type(policy).__name__, round(delay / control_period)
        if not isinstance(policy, Controller):
            raise ValueError(f"delay: {name} is no `control.base.Controller`")
        if robot.drive.kind != "tension":
            raise ValueError(f"delay: robot {robot.name!r} must be driven by tension")
        if steps < 1 or abs(steps * control_period - delay) > 1e-9:
            raise ValueError(f"delay: must be a multiple of {control_period:g} s, got {delay!r}")
        others = sorted(set(policy.requires) - _PREDICTED - _REFERENCE)
        if others:
            raise ValueError(f"delay: {name} reads {', '.join(others)}, which are not predicted")
        if not _REFERENCE & set(policy.requires):
            raise ValueError(f"delay: {name} follows no reference")
        self._policy, self._steps = policy, steps
        self._observer = rate_observer(robot, control_period)
        self._plane = [0, 2] if robot.moves_in_xz else [0, 1]
        self.requires = (*sorted(_PREDICTED), "reference_preview")
        self.hold = policy.hold
        self.preview = (delay, *(delay + time for time in policy.preview or ()))
        self.sizes = {k: v for k, v in policy.sizes.items() if k in _PREDICTED}

    def start(self, observation: Observation) -> PredictedState:
        """Begin at rest, with the action in force; the policy is yet to start."""
        in_force = usable(observation["previous_action"])
        return PredictedState(None, None, in_force, np.tile(in_force, (self._steps, 1)))

    def act(
        self, observation: Observation, state: PredictedState
    ) -> tuple[ndarray, PredictedState]:
        """The policy's action for the time when it arrives."""
        curvature = observation["curvature"]
        if state.estimate is None:
            estimate = self._observer.start(curvature)
        else:
            estimate = self._observer.update(state.estimate, state.applied, curvature)
        now = np.vstack([curvature, observation["curvature_rate"], estimate[2:]])
        then = now
        for action in state.sent:
            then = self._observer.predicted(then, action)
        action, inner = self._policy.predict(self._shown(observation, now, then), state.inner)
        sent = np.vstack([state.sent[1:], action])
        return action, PredictedState(inner, estimate, state.sent[0], sent)

    def _shown(self, observation: Observation, now: ndarray, then: ndarray) -> Observation:
        """What the policy sees, of the robot predicted from `now` (4, n) to be as `then`."""
        tip, preview = observation["tip_position"], observation["reference_preview"]
        way = self._observer.tip(then[0]) - self._observer.tip(now[0])
        size = len(tip)
        return {
            **observation,
            "curvature": then[0],
            "curvature_rate": then[1],
            "tip_position": tip + (way if size == 3 else way[self._plane]),
            "reference": preview[:size],
            "reference_preview": preview[size:],
        }

    # The policy itself holds its actions.
    _go_on = _decide = act
