"""Inverse statics as feedforward, alone or with PI feedback (the structure of thesis sec. 6.1)."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import find_artifact

from ..base import NOT_FINITE, REASONS, SATURATED, Controller, in_force
from .feedback import Feedback, FeedbackState
from .motion import Motion
from .nearby import Neighbourhood
from .statics import Rest, statics_of

#: Targets whose equilibria are remembered.
_REMEMBERED = 16


@dataclass(frozen=True)
class FeedforwardState:
    """State between two calls.

    Attributes:
        target: (k,) [m], point that `rest` belongs to.
        rest: The equilibrium with the tip on it, or nearest to it.
        solved: Equilibria of the last targets that were reached, by their bytes: set points often
            come again, and may take longer to solve than a period.
        memory: Memory of what is added to the statics.
        feedback: Memory of the feedback; None without.
        status: Why the action is not the intended one, or None.
    """

    target: ndarray
    rest: Rest
    solved: dict[bytes, Rest]
    memory: Any
    feedback: FeedbackState | None
    status: str | None


class Feedforward(Controller):
    """The inputs of least norm whose equilibrium puts the tip on the present reference.

    A quasi-static law for any robot: it continues the inverse statics along the reference from one
    decision to the next. Out of reach, the nearest inputs are held and the state's `status` says
    so.
    """

    requires = ("reference", "previous_action")
    _feedback: Feedback | None = None

    #: Memory at the beginning of a motion.
    _begun: Any = None

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        closed: bool = True,
        weights: str | Path | None = None,
    ) -> None:
        """Set up the statics.

        Args:
            robot: A robot with tendons.
            control_period: Any, [s].
            closed: Whether to use the closed form, where the robot has one, or its MuJoCo chain.
            weights: File of a network for the statics, see `training.quasi_static`.

        Raises:
            ValueError: The robot has no tendons, or the network belongs to another robot.
            FileNotFoundError: No such file.
        """
        self._statics = statics_of(robot, closed, weights)
        self._inputs = self._statics.inputs
        self.sizes = {"previous_action": self._inputs.n_inputs}
        if self._statics.dimension is not None:
            self.sizes |= dict.fromkeys(self._points(), self._statics.dimension)

    def _points(self) -> list[str]:
        """Observables of the same size as the reference."""
        return [n for n in self.requires if n.startswith(("reference", "tip_position"))]

    def start(self, observation: Observation) -> FeedforwardState:
        """Begin from the current inputs.

        Raises:
            ValueError: The reference does not have two or three coordinates, or another observable
                has a different number.
        """
        sizes = {len(observation[name]) for name in self._points()}
        if len(sizes) > 1 or not sizes <= {2, 3}:
            raise ValueError(
                f"{type(self).__name__} needs 2 or 3 entries of {', '.join(self._points())} each, "
                f"got {', '.join(str(len(observation[name])) for name in self._points())}"
            )
        inputs, size = self._inputs.from_actions(in_force(observation)), sizes.pop()
        law, rest = self._feedback, self._statics.begin(inputs)
        feedback = None if law is None else law.start(observation["reference"])
        return FeedforwardState(np.full(size, np.nan), rest, {}, self._begun, feedback, None)

    def act(
        self, observation: Observation, state: FeedforwardState
    ) -> tuple[ndarray, FeedforwardState]:
        """Inputs of the statics for the target, plus those added to them."""
        if not all(np.isfinite(observation[name]).all() for name in self.requires):
            return in_force(observation), replace(state, status=REASONS[NOT_FINITE])
        motion, rest, solved = self._motion(observation, state), state.rest, state.solved
        target = motion.position
        if not np.array_equal(target, state.target):  # a target often stands still
            key = target.tobytes()
            rest = solved.get(key)
            if rest is None:
                first = bool(np.isnan(state.target).any())
                rest = self._statics.hold(target, state.rest, first)
                if rest.reached:
                    last = list(solved.items())[-_REMEMBERED + 1 :]
                    solved = dict([*last, (key, rest)])
        inputs, memory, reason = self._added(observation, motion, rest, state)
        feedback, limited = state.feedback, False
        if self._feedback is not None:
            seen = observation["reference"], observation["tip_position"]
            more, feedback, limited = self._feedback.added(rest, motion, *seen, feedback)
            inputs = inputs + more
            if reason is not None:  # feedback must not compensate for this
                feedback = feedback.unlearned(state.feedback)
        wanted = self._inputs.to_actions(inputs)
        action = np.clip(wanted, -1.0, 1.0)
        limited = limited or np.any(np.abs(wanted) > 1 + 1e-9)
        reason = REASONS[SATURATED] if limited else reason
        status = reason if rest.reached else self._statics.missed
        return action, FeedforwardState(target, rest, solved, memory, feedback, status)

    def _motion(self, observation: Observation, state: FeedforwardState) -> Motion:
        """The target of the tip, (k,) [m], taken as at rest."""
        here = observation["reference"].copy()
        return Motion(here, np.zeros_like(here), np.zeros_like(here))

    def _added(
        self, observation: Observation, motion: Motion, rest: Rest, state: FeedforwardState
    ) -> tuple[ndarray, Any, str | None]:
        """Inputs (n_inputs,), the next memory, and why they are not the intended ones, or None."""
        return rest.inputs, state.memory, None


class FeedforwardPI(Feedforward):
    """u = u_ff(z_ref) + J+ (K_P e + K_I int e dt), see `Feedback`."""

    requires = ("reference", "previous_action", "tip_position")

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        proportional: float | None = None,
        integral: float | None = None,
        weights: str | Path | None = None,
        tip_delay: float = 0.0,
    ) -> None:
        """Set the gains.

        Args:
            robot: Nominal robot.
            control_period: [s] between calls.
            proportional, integral: See `Feedback`.
            weights: See `Feedforward`.
            tip_delay: [s], delay of the measured tip.
        """
        check_argument("control_period", control_period, Positive)
        super().__init__(robot, control_period, weights=weights)
        self._feedback = Feedback(
            self._statics,
            control_period,
            proportional,
            integral,
            tip_delay,
            self._learning(control_period),
            robot.drive.late,
        )

    def _learning(self, period: float) -> Neighbourhood | None:
        """The linearisation by which the robot's differences are learned; None if they are not."""


def make_network(
    robot: RobotParams, control_period: float, weights: str | Path | None = None
) -> Feedforward:
    """Statics by a network; its file is searched for unless given, see `artifacts.find_artifact`.

    Raises:
        ValueError, FileNotFoundError: No network for this robot, or no such file.
    """
    path = find_artifact(robot, "qs_nn") if weights is None else Path(weights)
    return Feedforward(robot, control_period, weights=path)
