"""Feedback of a measured tip to any feedforward law that knows the statics of its robot."""

from typing import NamedTuple

import numpy as np

from softrobot_env.control.feedforward.statics import Rest, Statics
from softrobot_env.fields import NotNegative, Positive, check_argument
from softrobot_env.robots import RobotParams

#: Shares of the limits of K_P and K_I, alone and with a stiffness learnt; the largest K_P.
_PROPORTIONAL, _INTEGRAL, _BESIDE, _LARGEST = 0.4, 0.45, 0.2, 2.0

#: Rate at which a stiffness is learnt, over the frequency of the first mode.
_LEARNING = 0.5

#: Least and largest share by which a robot is taken to be stiffer than its model.
_SOFTEST, _STIFFEST = -0.5, 1.0

#: Way of a softer robot's tip, as a share of the reach, below which little is learnt from it.
_LEAST_WAY = 0.02


class Sent(NamedTuple):
    """What a decision was about, kept until the tip is seen.

    Attributes:
        reference: (k,) [m].
        moved: (2, k) [m], how far corrections, and the ways c, have moved the tip by then.
    """

    reference: np.ndarray
    moved: np.ndarray


class Felt(NamedTuple):
    """What feedback remembers.

    Attributes:
        integral: (k,) [m s], of the tip's error.
        stiffer: s [1], the share by which the robot is stiffer than its model.
        mode: (2, 2, k), place [m] and rate [m/s] of the first mode, by corrections and by c.
        sent: The last decisions whose tip was not seen yet, oldest first.
    """

    integral: np.ndarray
    stiffer: float
    mode: np.ndarray
    sent: tuple[Sent, ...]

    def unlearnt(self, before: "Felt") -> "Felt":
        """The same without what was integrated since `before`."""
        return self._replace(integral=before.integral, stiffer=before.stiffer)


class Feedback:
    """Inputs that are added: J+ (K_P e + K_I int e dt), and what a robot stiffer by s needs.

    The error e = z_ref(t - d) - z is that of the time t - d when the tip was seen. J is the static
    tip Jacobian; J+ is damped, because J loses rank in the straight pose. Nothing is integrated
    while an input is at its limit (no wind-up).

    Quasi-statically the plant from J+ e to e has unit gain, and its first mode (frequency w,
    damping rate mu w^2) limits both gains: an action held for a period T for a tip seen d ago acts
    T / 2 + d late on average, which takes K_P w^2 (T / 2 + d) from the damping rate, so
    K_P < mu / (T / 2 + d); pure integral action needs K_I < mu w^2. The default gains are fractions
    of these limits, and K_P at most 2. They track better than feedforward alone but damp nothing,
    so that a step swings longer.

    A wrong stiffness is made up for all over the workspace, not at the last point alone: with c the
    way of the tip per share by which the robot is softer, and G the first mode with the delay,
    r = e + G(K_P e + K_I int e dt + s c) would be left without any correction, and of a robot
    stiffer by s that is s G(c). The share follows by

        s' = k c_G . (r - s c_G) / (c_G . c_G + c_0^2),   c_G = G(c).

    G foretells when a correction will be seen, so k is not limited by the mode. The share stays
    between a robot of half and of twice the stiffness.
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
            integral: K_I [1/s]; by default 0.45 of its limit, 0.2 where a stiffness is learnt.
            tip_delay: d [s], rounded to whole control periods, as environments do.
            learning: The robot of the statics, of its chain, to learn s; it stays 0 unless given.
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
        share, rate = _INTEGRAL if learning is None else _BESIDE, damping_time * frequency**2
        self._integral = share * rate if integral is None else integral
        self._learning = 0.0 if learning is None else _LEARNING * frequency
        if learning is not None:
            self._least_way = _LEAST_WAY * learning.reach
            self._mode = _held(frequency, damping_time, control_period)

    def start(self, reference: np.ndarray) -> Felt:
        """Begin with a reference (k,) [m] that was there before."""
        k = len(reference)
        sent = self._late * (Sent(reference.copy(), np.zeros((2, k))),)
        return Felt(np.zeros(k), 0.0, np.zeros((2, 2, k)), sent)

    def added(
        self, rest: Rest, reference: np.ndarray, tip: np.ndarray, felt: Felt
    ) -> tuple[np.ndarray, Felt, bool]:
        """Inputs (n_inputs,) to add where the statics are at rest, and whether one is limited.

        Args:
            rest: Of the model.
            reference, tip: (k,) [m], at the present and as seen; a tip that is not finite counts as
                where it should be.
            felt: What the last call returned.
        """
        sent = (*felt.sent, Sent(reference.copy(), felt.mode[0]))
        error = np.where(np.isfinite(tip), sent[0].reference - tip, 0.0)
        integral = felt.integral + self._period * error
        stiffer = self._learnt(error, sent[0].moved, felt.stiffer)
        change = self._proportional * error + self._integral * integral
        shifted, limited = self._statics.shifted(rest, change, stiffer)
        now = Felt(integral, stiffer, self._moving(rest, change, stiffer, felt.mode), sent[1:])
        return shifted - rest.inputs, now.unlearnt(felt) if limited else now, limited

    def _learnt(self, error: np.ndarray, moved: np.ndarray, stiffer: float) -> float:
        """The share s after an error (k,) [m] was seen."""
        if not self._learning:
            return stiffer
        corrected, way = moved
        left = error + corrected - stiffer * way
        gain = self._period * self._learning / (way @ way + self._least_way**2)
        return min(max(stiffer + gain * float(way @ left), _SOFTEST), _STIFFEST)

    def _moving(
        self, rest: Rest, change: np.ndarray, stiffer: float, mode: np.ndarray
    ) -> np.ndarray:
        """The first mode a period later."""
        if not self._learning:
            return mode
        way = self._statics.softened(rest, len(change), stiffer)
        free, forced = self._mode
        pulls = np.array([change + stiffer * way, way])
        return np.tensordot(free, mode, 1) + forced[:, None, None] * pulls


def _held(frequency: float, damping_time: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    """A (2, 2) and b (2,) of a mode x = (place, rate) a period later, A x + b u, with u held."""
    from scipy.linalg import expm

    square = frequency**2
    rates = np.array([[0.0, 1.0, 0.0], [-square, -damping_time * square, square], [0.0] * 3])
    found = expm(period * rates)
    return found[:2, :2], found[:2, 2]
