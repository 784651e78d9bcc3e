"""Feedback of the measured tip for any feedforward law that knows the statics of its robot."""

from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray
from numpy.linalg import norm

from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import NotNegative, Positive, check_argument

from ..base import NOT_FINITE, REASONS, Controller, in_force, usable
from .motion import DifferenceFilter, Differences, Motion
from .nearby import Nearby, Neighbourhood
from .statics import Rest, Statics

#: Shares of the limits of K_P and K_I; the largest K_P, and the largest K_P e as a share of the
#: reach, since the linearisation holds near a rest only. Tip displacements over the reach that no
#: robot makes: about an unstable rest, modes grow without bound.
_PROPORTIONAL, _INTEGRAL, _LARGEST, _FAR, _LOST = 0.4, 0.45, 2.0, 0.1, 1e3


class Sent(NamedTuple):
    """Data of a decision, kept until its tip is measured.

    Attributes:
        reference: (k,) [m].
        moved: (1 + n, k) [m], how far the corrections, and each of n differences, have moved the
            tip by then.
    """

    reference: ndarray
    moved: ndarray


class FeedbackState(NamedTuple):
    """Memory of the feedback.

    Attributes:
        integral: (k,) [m s], of the tip's error.
        differs: How the robot differs from its model; None if that is not learned.
        mode: (2 r, 1 + n), r modes and their rates, due to corrections and to n differences.
        moved: (1 + n, k) [m], displacements of the tip due to the same.
        near: Linearisation about the rest of the last decision; None before.
        sent: The last decisions whose tip has not been measured yet, oldest first.
    """

    integral: ndarray
    differs: Differences | None
    mode: ndarray
    moved: ndarray
    near: Nearby | None
    sent: tuple[Sent, ...]

    def unlearned(self, before: "FeedbackState") -> "FeedbackState":
        """The same memory without what was learned since `before`."""
        return self._replace(integral=before.integral, differs=before.differs)


class Feedback:
    """Added inputs: J+ (K_P e + K_I int e dt), or those that learned model errors require.

    The error e = z_ref(t - d) - z belongs to the time t - d at which the tip was measured. J is the
    static tip Jacobian; J+ is damped, because J loses rank in the straight pose. Nothing is
    integrated while an input is at its limit (no wind-up).

    Quasi-statically the plant from J+ e to e has unit gain, and its first mode (frequency w,
    damping rate mu w^2) limits both gains: an action held for a period T, for a tip measured d ago,
    by drives that are d' late, acts T / 2 + d + d' late on average, which takes K_P w^2 times that
    from the damping rate, so K_P < mu / (T / 2 + d + d'); pure integral action needs K_I < mu w^2.
    The default gains are fractions of these limits, and K_P at most 2. They track better than
    feedforward alone but add no damping, so that a step oscillates longer.

    An integral compensates for model errors only at the last point. Instead, a Kalman filter can
    learn them for the whole workspace: offsets of the inputs, stiffness, damping, a rotation of the
    tendons, a weight at the tip (`Differences`). Let G be the motion of the tip (`Nearby`)
    including the delay, u the displacement that all corrections should cause, and Phi the
    displacements by each difference: without corrections the error would be e + G(u), which equals
    -G(Phi) times the differences. G predicts when a correction becomes visible.
    """

    def __init__(
        self,
        statics: Statics,
        control_period: float,
        proportional: float | None = None,
        integral: float | None = None,
        tip_delay: float = 0.0,
        learning: Neighbourhood | None = None,
        drive_delay: float = 0.0,
    ) -> None:
        """Set the gains.

        Args:
            statics: Of the nominal robot.
            control_period: [s] between calls.
            proportional: K_P [1]; by default 0.4 of its limit, at most 2.
            integral: K_I [1/s]; by default 0.45 of its limit, 0 where differences are learned.
            tip_delay: d [s], rounded to whole control periods, as environments do.
            learning: Linearisation of a chain's statics, to learn how a robot differs from it.
            drive_delay: d' [s], lag of the drives.
        """
        check_argument("control_period", control_period, Positive)
        check_argument("proportional", proportional, NotNegative | None)
        check_argument("integral", integral, NotNegative | None)
        check_argument("tip_delay", tip_delay, NotNegative)
        self._statics, self._period = statics, control_period
        self._late = round(tip_delay / control_period)
        self._acts = round(drive_delay / control_period)
        frequency, damping_time = statics.first_mode()
        limit = damping_time / (control_period * (0.5 + self._late) + drive_delay)
        gain = min(_LARGEST, _PROPORTIONAL * limit)
        self._proportional = gain if proportional is None else proportional
        share = _INTEGRAL * damping_time * frequency**2 if learning is None else 0.0
        self._integral = share if integral is None else integral
        self._filter, self._near = None, learning
        self._far = np.inf if learning is None else _FAR * learning.reach
        if learning is not None:
            n_inputs = statics.inputs.n_inputs
            self._filter = DifferenceFilter(
                n_inputs, learning.n_built, learning.reach, frequency, control_period
            )

    def start(self, reference: ndarray) -> FeedbackState:
        """Begin with a reference (k,) [m] that has been constant until now."""
        k = len(reference)
        differs = None if self._filter is None else self._filter.begin()
        n = 1 + (0 if differs is None else len(differs.mean))
        moved = np.zeros((n, k))
        mode = np.zeros((0 if differs is None else 2 * self._near.modes.shape[1], n))
        before = (self._late + self._acts) * (Sent(reference.copy(), moved),)
        return FeedbackState(np.zeros(k), differs, mode, moved, None, before)

    def added(
        self, rest: Rest, motion: Motion, reference: ndarray, tip: ndarray, before: FeedbackState
    ) -> tuple[ndarray, FeedbackState, bool]:
        """Inputs (n_inputs,) to add to those of the statics, and whether one is at its limit.

        Args:
            rest: Rest of the model.
            motion: Motion of the reference, (k,) each, when the inputs act.
            reference, tip: (k,) [m], the present one and the measured one; a tip that is not finite
                counts as being on the reference, and nothing is learned from it.
            before: Result of the last call.
        """
        sent = (*before.sent, Sent(reference.copy(), before.moved))
        seen = sent[self._acts]
        error = np.where(np.isfinite(tip), seen.reference - tip, 0.0)
        integral = before.integral + self._period * error
        near = min(1.0, self._far / max(self._proportional * norm(error), 1e-300))
        change = near * self._proportional * error + self._integral * integral
        now = before._replace(integral=integral, sent=sent[1:])
        if self._filter is None:
            shifted, limited = self._statics.shifted(rest, change)
        else:
            if np.isfinite(tip).all():
                left, far = error + sent[0].moved[0], float(norm(error))
                differs = self._filter.updated(before.differs, left, seen.moved[1:], far)
                now = now._replace(differs=differs)
            shifted, now, limited = self._made_up(rest, motion, change, now)
        return shifted - rest.inputs, now.unlearned(before) if limited else now, limited

    def _made_up(
        self, rest: Rest, motion: Motion, change: ndarray, memory: FeedbackState
    ) -> tuple[ndarray, FeedbackState, bool]:
        """Inputs (n_inputs,) against model errors, next memory, and whether one is limited."""
        differs, inputs = memory.differs, self._statics.inputs
        near = self._near.about(rest, motion, differs, memory.near)
        if near is None:
            return rest.inputs, memory, True
        n, own = inputs.n_inputs, near.rest
        shifted, limited = self._statics.shifted(own, change - near.moving, near.linear)
        shifted = shifted - differs.mean[3 : 3 + n] * inputs.input_scale
        beyond = np.abs(shifted - inputs.input_centre) >= inputs.input_scale
        corrected = near.by_inputs @ ((shifted - own.inputs) / inputs.input_scale) - near.held
        mode, moved = near.later(memory.mode, np.column_stack([corrected, near.forces]))
        if not np.abs(moved).max() < _LOST * self._near.reach:
            mode, moved = np.zeros_like(mode), np.zeros_like(moved)
        memory = memory._replace(mode=mode, moved=moved, near=near)
        return shifted, memory, limited or bool(beyond.any())


_TIP, _NOT_FINITE = "tip_position", REASONS[NOT_FINITE]


class ReferenceState(NamedTuple):
    """State between two calls.

    Attributes:
        inner: State of the policy whose reference is shifted.
        integral: (k,) [m s], of the tip's error.
        sent: (n, k) [m], references whose tip has not been measured yet, oldest first.
        status: Status of that policy, or that the tip is not visible.
        begun: Whether the tip has been visible before.
    """

    inner: Any
    integral: ndarray
    sent: ndarray
    status: str | None = None
    begun: bool = False


class ReferenceFeedback(Controller):
    """Give another policy the reference z_ref + u_C, u_C = K_P e + K_I int e dt, (6.1) to (6.3).

    The error e = z_ref(t - d) - z belongs to the time at which the tip was measured. A tip that is
    not finite counts as being on the reference; until the first one that is, the current action is
    kept.
    """

    def __init__(
        self,
        policy: Controller,
        control_period: float,
        proportional: float,
        integral: float,
        tip_delay: float = 0.0,
    ) -> None:
        """Add feedback to a policy.

        Args:
            policy: Any controller that reads a reference.
            control_period: [s] between calls.
            proportional: K_P [1].
            integral: K_I [1/s].
            tip_delay: d [s], rounded to whole control periods.

        Raises:
            ValueError: A gain or the delay is negative, the period is not positive, or the policy
                does not declare how many coordinates of a reference it reads.
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
        """Begin without accumulated error."""
        reference = usable(np.array(observation["reference"], float))
        sent = np.tile(reference, (self._late, 1))
        return ReferenceState(self._policy.start(observation), np.zeros_like(reference), sent)

    def act(
        self, observation: Observation, state: ReferenceState
    ) -> tuple[ndarray, ReferenceState]:
        """The action of the policy for the shifted reference."""
        reference, tip = observation["reference"], observation[_TIP]
        is_seen = bool(np.isfinite(tip).all())
        if not (is_seen or state.begun):
            return in_force(observation), state._replace(status=_NOT_FINITE)
        sent = np.vstack([state.sent, np.where(np.isfinite(reference), reference, usable(tip))])
        error = sent[0] - tip if is_seen else np.zeros(len(tip))
        integral = state.integral + self._period * self.hold * error
        shift = self._proportional * error + self._integral * integral
        shifted = {**observation, "reference": reference + shift}
        action, inner = self._policy.act(shifted, state.inner)
        status = getattr(inner, "status", None) if is_seen else _NOT_FINITE
        return action, ReferenceState(inner, integral, sent[1:], status, True)
