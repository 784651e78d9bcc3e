"""Compensation of a known delay: policies see the robot as it will be when their actions arrive."""

from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Observation, Policy
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs

from .base import Controller, Held, usable
from .observers import RateObserver, rate_observer

_REFERENCE = frozenset({"reference", "reference_preview"})

#: What the environment shows for the time when the action arrives.
_LED = frozenset({"reference_velocity", "reference_acceleration"})

#: What an observer predicts.
_ROBOT = frozenset({"curvature", "curvature_rate", "tip_position"})

_KNOWN = _REFERENCE | _LED | _ROBOT | {"previous_action"}


def unpredicted(policy: Policy, robot: RobotParams) -> str | None:
    """Why a robot's policy cannot compensate for a delay, or None if it can."""
    name = type(policy).__name__
    if not isinstance(policy, Controller):
        return f"delay: {name} is no `control.base.Controller`"
    pulled = {"tendon_length"} if robot.drive.kind == "length" else set()
    if others := sorted(set(policy.requires) - _KNOWN - pulled):
        return f"delay: {name} reads {', '.join(others)}, which are not predicted"
    return None if _REFERENCE & set(policy.requires) else f"delay: {name} follows no reference"


class PredictedState(NamedTuple):
    """State between two calls.

    Attributes:
        inner: State of the policy.
        estimate: (4, n), see `RateObserver`; None before the first call and without an observer.
        applied: (m,) [1], action applied since the last call.
        sent: (k, m) [1], actions still on their way, oldest first.
    """

    inner: Any
    estimate: ndarray | None
    applied: ndarray
    sent: ndarray

    #: As in the policy.
    status = Held.status


class DelayCompensation(Controller):
    """A policy that sees its robot and the reference as they will be when its action arrives.

    The model of an observer predicts curvatures and rates over the delay, under the actions on
    their way and the unexplained forces that the observer has estimated; the tip moves with them.
    Servos wind their tendons towards the commands at their limited speed. The environment shows the
    reference from that time on.
    """

    def __init__(
        self,
        policy: Controller,
        robot: RobotParams,
        control_period: float,
        delay: float,
        late_tip: bool = False,
    ) -> None:
        """Wrap a policy.

        Args:
            policy: Any controller that follows a reference and reads only its derivatives,
                curvatures, their rates, the tip's position, tendon lengths and the current action.
            robot: Nominal robot.
            control_period: [s] between calls.
            delay: [s] between a call and the time when its action is applied.
            late_tip: Whether the policy accounts for a tip seen late, by the delay and perhaps the
                camera's: it is then shown the tip as measured.

        Raises:
            ValueError: The policy cannot be compensated, or the delay is not a multiple of the
                control period.
        """
        check_argument("control_period", control_period, Positive)
        check_argument("delay", delay, Positive)
        steps = round(delay / control_period)
        if steps < 1 or abs(steps * control_period - delay) > 1e-9:
            raise ValueError(f"delay: must be a multiple of {control_period:g} s, got {delay!r}")
        if reason := unpredicted(policy, robot):
            raise ValueError(reason)
        read = set(policy.requires)
        self._policy, self._steps = policy, steps
        self._predicted = read & (_ROBOT | {"tendon_length"})
        if late_tip:
            self._predicted -= {"tip_position"}
        self._observer: RateObserver | None = None
        if self._predicted:
            self._observer = rate_observer(robot, control_period)
            read |= {"curvature", "curvature_rate", "tip_position", self._observer.in_force}
        self._scale = robot_inputs(robot).input_scale
        self._most = robot.drive.speed * control_period
        self._plane = [0, 2] if robot.moves_in_xz else [0, 1]
        read |= {"previous_action", *_REFERENCE}
        self.requires = tuple(sorted(read))
        self.hold, times = policy.hold, policy.preview or ()
        self.preview = (delay, *(delay + time for time in times))
        self.sizes = {k: n for k, n in policy.sizes.items() if k != "reference_preview"}
        if "reference" in self.sizes:
            self.sizes["reference_preview"] = self.sizes["reference"] * len(self.preview)

    def start(self, observation: Observation) -> PredictedState:
        """Begin at rest, with the current action; the policy has not started yet."""
        in_force = usable(observation["previous_action"])
        return PredictedState(None, None, in_force, np.tile(in_force, (self._steps, 1)))

    def act(
        self, observation: Observation, state: PredictedState
    ) -> tuple[ndarray, PredictedState]:
        """The policy's action for the time when it arrives."""
        preview, size = observation["reference_preview"], len(observation["reference"])
        shown = {"reference": preview[:size], "reference_preview": preview[size:]}
        estimate = state.estimate
        if self._observer is not None:
            estimate = self._estimated(observation, state)
            shown |= self._then(observation, estimate, state.sent)
        action, inner = self._policy.predict({**observation, **shown}, state.inner)
        sent = np.vstack([state.sent[1:], action])
        return action, PredictedState(inner, estimate, state.sent[0], sent)

    def _estimated(self, observation: Observation, state: PredictedState) -> ndarray:
        """Estimate (4, n) of the robot now."""
        curvature, applied = observation["curvature"], state.applied
        if state.estimate is None:
            return self._observer.start(curvature)
        if self._observer.in_force == "tendon_length":
            applied = observation["tendon_length"]
        return self._observer.update(state.estimate, applied, curvature)

    def _then(self, observation: Observation, estimate: ndarray, sent: ndarray) -> Observation:
        """What the policy sees of the robot once the actions (k, m) sent have been applied."""
        now = np.vstack([observation["curvature"], observation["curvature_rate"], estimate[2:]])
        then, length = now, observation.get("tendon_length")
        for action in sent:
            applied = action
            if self._observer.in_force == "tendon_length":
                way = np.clip(action * self._scale - length, -self._most, self._most)
                applied = length = length + way
            then = self._observer.predicted(then, applied)
        tip = observation["tip_position"]
        if "tip_position" in self._predicted:
            way = self._observer.tip(then[0]) - self._observer.tip(now[0])
            tip = tip + (way if len(tip) == 3 else way[self._plane])
        seen = {"curvature": then[0], "curvature_rate": then[1], "tip_position": tip}
        seen["tendon_length"] = length
        return {name: seen[name] for name in self._predicted}

    # The policy holds its actions itself.
    _go_on = _decide = act
