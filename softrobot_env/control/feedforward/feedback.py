"""Feedback of a measured tip to any feedforward law that knows the statics of its robot."""

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
#: reach: what holds near a rest says little of what is far away. Ways over it that no robot moves
#: by: about an unstable rest modes grow without end.
_PROPORTIONAL, _INTEGRAL, _LARGEST, _FAR, _LOST = 0.4, 0.45, 2.0, 0.1, 1e3


class Sent(NamedTuple):
    """What a decision was about, kept until the tip is seen.

    Attributes:
        reference: (k,) [m].
        moved: (1 + n, k) [m], how far corrections, and the ways of n differences, have moved the
            tip by then.
    """

    reference: ndarray
    moved: ndarray


class FeedbackState(NamedTuple):
    """What feedback remembers.

    Attributes:
        integral: (k,) [m s], of the tip's error.
        differs: How the robot differs from its model; None where that is not learned.
        mode: (2 r, 1 + n), r modes and their rates, by corrections and by n differences.
        moved: (1 + n, k) [m], the tip by the same.
        near: What was near the rest at the last decision; None before.
        sent: The last decisions whose tip was not seen yet, oldest first.
    """

    integral: ndarray
    differs: Differences | None
    mode: ndarray
    moved: ndarray
    near: Nearby | None
    sent: tuple[Sent, ...]

    def unlearned(self, before: "FeedbackState") -> "FeedbackState":
        """The same without what was learned since `before`."""
        return self._replace(integral=before.integral, differs=before.differs)


class Feedback:
    """Inputs that are added: J+ (K_P e + K_I int e dt), or what a robot that differs needs.

    The error e = z_ref(t - d) - z is that of the time t - d when the tip was seen. J is the static
    tip Jacobian; J+ is damped, because J loses rank in the straight pose. Nothing is integrated
    while an input is at its limit (no wind-up).

    Quasi-statically the plant from J+ e to e has unit gain, and its first mode (frequency w,
    damping rate mu w^2) limits both gains: an action held for a period T for a tip seen d ago, by
    drives that are d' late, acts T / 2 + d + d' late on average, which takes K_P w^2 times that
    from the damping rate, so K_P < mu / (T / 2 + d + d'); pure integral action needs
    K_I < mu w^2. The default gains are fractions of these limits, and K_P at most 2. They track
    better than feedforward alone but damp nothing, so that a step swings longer.

    An integral makes up for what is wrong at the last point alone. In its place a Kalman filter
    learns what is wrong all over the workspace: offsets of the inputs, a stiffness, a damping, a
    turn of the tendons, a weight at the tip (`Differences`). With G the motion of the tip
    (`Nearby`) with the delay, u the way that all corrections should move the tip by, and Phi the
    ways by each difference, e + G(u) is what the error would be without them, -G(Phi) times the
    differences. G foretells when a correction will be seen.
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
            statics: Of the robot as its model says.
            control_period: [s] between calls.
            proportional: K_P [1]; by default 0.4 of its limit, at most 2.
            integral: K_I [1/s]; by default 0.45 of its limit, 0 where differences are learned.
            tip_delay: d [s], rounded to whole control periods, as environments do.
            learning: Of the statics, of a chain, to learn how a robot differs from it.
            drive_delay: d' [s], how late drives follow.
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
        """Begin with a reference (k,) [m] that was there before."""
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
        """Inputs (n_inputs,) to add where the statics are at rest, and whether one is limited.

        Args:
            rest: Of the model.
            motion: Of the reference, (k,) each, when the inputs act.
            reference, tip: (k,) [m], at the present and as seen; a tip that is not finite counts as
                where it should be, and nothing is learned from it.
            before: What the last call returned.
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
        """Inputs (n_inputs,) of a robot that differs, the next memory, and if one is limited."""
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
    """What the next call needs.

    Attributes:
        inner: State of the policy whose reference is shifted.
        integral: (k,) [m s], of the tip's error.
        sent: (n, k) [m], references whose tip was not seen yet, oldest first.
        status: Of that policy, or that the tip is not seen.
        begun: Whether the tip was seen before.
    """

    inner: Any
    integral: ndarray
    sent: ndarray
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
