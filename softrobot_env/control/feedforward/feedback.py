"""Feedback of a measured tip to any feedforward law that knows the statics of its robot."""

from typing import NamedTuple

import numpy as np

from softrobot_env.control.feedforward.statics import Rest, Statics
from softrobot_env.fields import NotNegative, Positive, check_argument

#: Shares of the limits of K_P and K_I; the largest K_P.
_PROPORTIONAL, _INTEGRAL, _LARGEST = 0.4, 0.45, 2.0

#: Way of a softer robot's tip, as a share of the reach, below which little is learnt from it.
LEAST_WAY = 0.02


class Felt(NamedTuple):
    """What feedback remembers.

    Attributes:
        integral: (k,) [m s], of the tip's error.
        stiffer: s [1], the share by which the robot is stiffer than its model.
        references: Those of the last decisions that no tip was measured for yet, oldest first.
    """

    integral: np.ndarray
    stiffer: float = 0.0
    references: tuple[np.ndarray, ...] = ()

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

    With c the way of the tip per share by which the robot is softer, s' = K_I (c . e) /
    (c . c + c_0^2): a wrong stiffness is so made up for all over the workspace, not at the last
    point alone.
    """

    def __init__(
        self,
        statics: Statics,
        control_period: float,
        proportional: float | None = None,
        integral: float | None = None,
        delay: float = 0.0,
        least_way: float | None = None,
    ) -> None:
        """Set the gains.

        Args:
            statics: Of the robot as its model says.
            control_period: [s] between calls.
            proportional: K_P [1]; by default 0.4 of its limit, at most 2.
            integral: K_I [1/s]; by default 0.45 of its limit.
            delay: d [s], rounded to whole control periods, as environments do.
            least_way: c_0 [m], way below which little is learnt of s; None: nothing ever.
        """
        check_argument("control_period", control_period, Positive)
        check_argument("proportional", proportional, NotNegative | None)
        check_argument("integral", integral, NotNegative | None)
        check_argument("delay", delay, NotNegative)
        self._statics, self._period, self._least_way = statics, control_period, least_way
        self._late = round(delay / control_period)
        frequency, damping_time = statics.first_mode()
        limit = damping_time / (control_period * (0.5 + self._late))
        gain = min(_LARGEST, _PROPORTIONAL * limit)
        self._proportional = gain if proportional is None else proportional
        rate = _INTEGRAL * damping_time * frequency**2
        self._integral = rate if integral is None else integral

    def start(self, reference: np.ndarray) -> Felt:
        """Begin with a reference (k,) [m] that was there before."""
        return Felt(np.zeros(len(reference)), references=self._late * (reference.copy(),))

    def added(
        self, rest: Rest, reference: np.ndarray, tip: np.ndarray, felt: Felt
    ) -> tuple[np.ndarray, Felt, bool]:
        """Inputs (n_inputs,) to add where the statics are at rest, and whether one is limited.

        Args:
            rest: Of the model.
            reference, tip: (k,) [m], at the present and as seen.
            felt: What the last call returned.
        """
        references = (*felt.references, reference.copy())
        error = np.where(np.isfinite(tip), references[0] - tip, 0.0)
        integral, stiffer = felt.integral + self._period * error, felt.stiffer
        if self._least_way is not None:
            way = self._statics.softened(rest, len(error), stiffer)
            learnt = way @ error / (way @ way + self._least_way**2)
            stiffer += self._period * self._integral * learnt
        change = self._proportional * error + self._integral * integral
        shifted, limited = self._statics.shifted(rest, change, stiffer)
        now = Felt(integral, stiffer, references[1:])
        return shifted - rest.inputs, now.unlearnt(felt) if limited else now, limited
