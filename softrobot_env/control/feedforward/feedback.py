"""Feedback of a measured tip to any feedforward law that knows the statics of its robot."""

from typing import NamedTuple

import numpy as np

from softrobot_env.control.feedforward.differences import DifferenceFilter, Differences
from softrobot_env.control.feedforward.statics import Rest, Statics
from softrobot_env.fields import NotNegative, Positive, check_argument
from softrobot_env.robots import RobotParams

#: Shares of the limits of K_P and K_I; the largest K_P.
_PROPORTIONAL, _INTEGRAL, _LARGEST = 0.4, 0.45, 2.0


class Sent(NamedTuple):
    """What a decision was about, kept until the tip is seen.

    Attributes:
        reference: (k,) [m].
        moved: (1 + n, k) [m], how far corrections, and the ways of n differences, have moved the
            tip by then.
    """

    reference: np.ndarray
    moved: np.ndarray


class Felt(NamedTuple):
    """What feedback remembers.

    Attributes:
        integral: (k,) [m s], of the tip's error.
        differs: How the robot differs from its model; None where that is not learned.
        mode: (2, 1 + n, k), place [m] and rate [m/s] of the first mode, by corrections and by the
            ways of n differences.
        sent: The last decisions whose tip was not seen yet, oldest first.
    """

    integral: np.ndarray
    differs: Differences | None
    mode: np.ndarray
    sent: tuple[Sent, ...]

    def unlearnt(self, before: "Felt") -> "Felt":
        """The same without what was learned since `before`."""
        return self._replace(integral=before.integral, differs=before.differs)


class Feedback:
    """Inputs that are added: J+ (K_P e + K_I int e dt), or what a robot that differs needs.

    The error e = z_ref(t - d) - z is that of the time t - d when the tip was seen. J is the static
    tip Jacobian; J+ is damped, because J loses rank in the straight pose. Nothing is integrated
    while an input is at its limit (no wind-up).

    Quasi-statically the plant from J+ e to e has unit gain, and its first mode (frequency w,
    damping rate mu w^2) limits both gains: an action held for a period T for a tip seen d ago acts
    T / 2 + d late on average, which takes K_P w^2 (T / 2 + d) from the damping rate, so
    K_P < mu / (T / 2 + d); pure integral action needs K_I < mu w^2. The default gains are fractions
    of these limits, and K_P at most 2. They track better than feedforward alone but damp nothing,
    so that a step swings longer.

    An integral makes up for what is wrong at the last point alone. In its place a Kalman filter
    learns what is wrong all over the workspace: offsets of the inputs, a stiffness, a weight at the
    tip (`Differences`). With G the first mode with the delay, u the way that all corrections should
    move the tip by, and Phi the ways by each difference, e + G(u) is what the error would be
    without them, -G(Phi) times the differences. G foretells when a correction will be seen.
    """

    def __init__(
        self,
        statics: Statics,
        control_period: float,
        proportional: float | None = None,
        integral: float | None = None,
        tip_delay: float = 0.0,
        learning: RobotParams | None = None,
    ) -> None:
        """Set the gains.

        Args:
            statics: Of the robot as its model says.
            control_period: [s] between calls.
            proportional: K_P [1]; by default 0.4 of its limit, at most 2.
            integral: K_I [1/s]; by default 0.45 of its limit, 0 where differences are learned.
            tip_delay: d [s], rounded to whole control periods, as environments do.
            learning: The robot of the statics, of its chain, to learn how another differs from it.
        """
        check_argument("control_period", control_period, Positive)
        check_argument("proportional", proportional, NotNegative | None)
        check_argument("integral", integral, NotNegative | None)
        check_argument("tip_delay", tip_delay, NotNegative)
        self._statics, self._period = statics, control_period
        self._late = round(tip_delay / control_period)
        frequency, damping_time = statics.first_mode()
        limit = damping_time / (control_period * (0.5 + self._late))
        gain = min(_LARGEST, _PROPORTIONAL * limit)
        self._proportional = gain if proportional is None else proportional
        share = _INTEGRAL * damping_time * frequency**2 if learning is None else 0.0
        self._integral = share if integral is None else integral
        self._filter = None
        if learning is not None:
            n_inputs = statics.inputs.n_inputs
            self._filter = DifferenceFilter(n_inputs, learning.reach, frequency, control_period)
            self._mode = _held(frequency, damping_time, control_period)

    def start(self, reference: np.ndarray) -> Felt:
        """Begin with a reference (k,) [m] that was there before."""
        k = len(reference)
        differs = None if self._filter is None else self._filter.begin()
        mode = np.zeros((2, 1 + (0 if differs is None else len(differs.mean)), k))
        return Felt(np.zeros(k), differs, mode, self._late * (Sent(reference.copy(), mode[0]),))

    def added(
        self, rest: Rest, reference: np.ndarray, tip: np.ndarray, felt: Felt
    ) -> tuple[np.ndarray, Felt, bool]:
        """Inputs (n_inputs,) to add where the statics are at rest, and whether one is limited.

        Args:
            rest: Of the model.
            reference, tip: (k,) [m], at the present and as seen; a tip that is not finite counts as
                where it should be, and nothing is learned from it.
            felt: What the last call returned.
        """
        sent = (*felt.sent, Sent(reference.copy(), felt.mode[0]))
        error = np.where(np.isfinite(tip), sent[0].reference - tip, 0.0)
        integral = felt.integral + self._period * error
        change = self._proportional * error + self._integral * integral
        now = felt._replace(integral=integral, sent=sent[1:])
        if self._filter is None:
            shifted, limited = self._statics.shifted(rest, change)
        else:
            if np.isfinite(tip).all():
                corrected, ways = sent[0].moved[0], sent[0].moved[1:]
                differs = self._filter.updated(felt.differs, error + corrected, ways)
                now = now._replace(differs=differs)
            shifted, now, limited = self._made_up(rest, change, now)
        return shifted - rest.inputs, now.unlearnt(felt) if limited else now, limited

    def _made_up(self, rest: Rest, change: np.ndarray, felt: Felt) -> tuple[np.ndarray, Felt, bool]:
        """Inputs (n_inputs,) of a robot that differs, what is felt, and whether one is limited."""
        differs, inputs = felt.differs, self._statics.inputs
        ways = self._statics.ways(rest, len(change), differs.stiffer)
        lifted = change - differs.weight * ways[-1]
        shifted, limited = self._statics.shifted(rest, lifted, differs.stiffer)
        shifted = shifted - differs.offset * inputs.input_scale
        beyond = np.abs(shifted - inputs.input_centre) >= inputs.input_scale
        free, forced = self._mode
        pulls = np.vstack([change - differs.mean @ ways, ways])
        mode = np.tensordot(free, felt.mode, 1) + forced[:, None, None] * pulls
        return shifted, felt._replace(mode=mode), limited or bool(beyond.any())


def _held(frequency: float, damping_time: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    """A (2, 2) and b (2,) of a mode x = (place, rate) a period later, A x + b u, with u held."""
    from scipy.linalg import expm

    square = frequency**2
    rates = np.array([[0.0, 1.0, 0.0], [-square, -damping_time * square, square], [0.0] * 3])
    found = expm(period * rates)
    return found[:2, :2], found[:2, 2]
