"""A policy for full-state feedback, given tip and curvatures only."""

from typing import Any, NamedTuple

import numpy as np

from softrobot_env.control.base import Controller
from softrobot_env.control.observer import RateObserver
from softrobot_env.interfaces import Observation


class ObservedState(NamedTuple):
    """State of `OutputFeedback`.

    Attributes:
        estimate: (4, n), of the observer.
        inner: State of the policy.
    """

    estimate: np.ndarray
    inner: Any

    @property
    def status(self) -> str | None:
        """Why the action is not the one wanted, or None."""
        return getattr(self.inner, "status", None)


class OutputFeedback(Controller):
    """A policy whose curvature rates come from an observer.

    The observer goes on in every control period, also while the policy holds its action.
    Policies that estimate unexplained forces themselves then do so in series with the observer:
    `mpc_preview` oscillates if the robot is a third as heavy as it was told.
    """

    def __init__(self, policy: Controller, observer: RateObserver) -> None:
        self._policy, self._observer = policy, observer
        self.hold = policy.hold
        measured = ("curvature", "previous_action")
        others = (n for n in policy.requires if n not in (*measured, "curvature_rate"))
        self.requires = (*measured, *others)
        self.sizes = {k: v for k, v in policy.sizes.items() if k in self.requires}

    def start(self, observation: Observation) -> ObservedState:
        """At rest, with the policy yet to start."""
        return ObservedState(self._observer.start(observation["curvature"]), None)

    def act(
        self, observation: Observation, state: ObservedState
    ) -> tuple[np.ndarray, ObservedState]:
        """The policy's action with estimated rates."""
        estimate = state.estimate
        if state.inner is not None:
            estimate = self._observer.update(
                estimate, observation["previous_action"], observation["curvature"]
            )
        full = {**observation, "curvature_rate": estimate[1]}
        action, inner = self._policy.predict(full, state.inner)
        return action, ObservedState(estimate, inner)

    def _go_on(
        self, observation: Observation, state: ObservedState
    ) -> tuple[np.ndarray, ObservedState]:
        return self.act(observation, state)

    def _decide(
        self, observation: Observation, inner: ObservedState
    ) -> tuple[np.ndarray, ObservedState]:
        return self.act(observation, inner)
