"""A rod that hangs in a plane, pulled by one straight tendon that rubs on its whole way, exactly.

With theta(s) the angle from the vertical, N = (X, Z) what is left of weight and load beyond s, m
its moment about s and T the tension of the tendon at distance r from the fibre, at rest

    x' = sin(theta),  z' = cos(theta),  theta' = kappa = (r T + m) / EI,
    m' = N_z sin(theta) - N_x cos(theta),  m(L) = 0.

A tendon that slides obeys T' = -mu T |kappa| where it is pulled in and T' = mu T |kappa| where it
is let out. Where it sticks the length beyond does not change, so that neither does kappa: T follows
from the balance, and Coulomb's law asks for |T'| <= mu T |kappa|. After a reversal the tendon
slides between the base and the place where kappa meets its old value, and sticks beyond. The
solution by shooting from the base is checked for what it takes for granted: that law where the
tendon sticks, and one direction of sliding elsewhere (complementarity).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from scipy.integrate import solve_ivp
from scipy.optimize import root_scalar

_RTOL, _ATOL = 1e-10, 1e-12
_SLACK = 1e-7  # share of mu T |kappa| that is rounding
_CHECKED = np.linspace(0, 1, 401)[1:-1]

#: A function of arc lengths (n,).
Profile = Callable[[ndarray], ndarray]


@dataclass(frozen=True)
class HangingRod:
    """The rod.

    Attributes:
        length: [m].
        bending: EI [N m2].
        distance: [m] of the tendon from the fibre, r.
        coefficient: mu [1].
        weight: [N/m].
        load: (2,) [N] at the tip, sideways and down.
    """

    length: float
    bending: float
    distance: float
    coefficient: float
    weight: float = 0.0
    load: tuple[float, float] = (0.0, 0.0)

    def tip_angles(self, tensions: Sequence[float]) -> ndarray:
        """Angles (n,) [rad] of the tip as tension at the base goes slowly from one to the next.

        Args:
            tensions: (n,) [N], growing from 0 to the largest, then falling, then growing to the
                largest at most.

        Raises:
            ValueError: The solution is not of the kind that it is taken for.
        """
        out, last, frozen, before = [], 0.0, None, None
        rest = self._solve(0.0, 1, None, 0.0)
        now, sign = rest, 1
        for tension in tensions:
            if sign * (tension - last) < 0:
                sign, frozen = -sign, now
            before, now = now, self._solve(tension, sign, frozen, now.root)
            if frozen is None:
                self._check_growth(before.curvature, now.curvature)
            out.append(now.angle)
            last = tension
        return np.array(out)

    def _solve(self, tension: float, sign: int, frozen: "_Shape | None", guess: float) -> "_Shape":
        """At rest, sliding as it pulls in (1) or lets out (-1) up to where it has `frozen`."""

        def missed(root: float) -> float:
            return self._shot(tension, sign, frozen, root).moment(np.array([self.length]))[0]

        if not (self.weight or any(self.load)):
            return self._checked(self._shot(tension, sign, frozen, 0.0), frozen)
        scale = self.weight * self.length**2 + np.hypot(*self.load) * self.length
        near = guess + 1e-3 * scale
        found = root_scalar(missed, x0=guess, x1=near, xtol=1e-13 * scale, maxiter=100)
        if not found.converged:
            raise ValueError(f"no balance found at {tension} N")
        return self._checked(self._shot(tension, sign, frozen, found.root), frozen)

    def _shot(self, tension: float, sign: int, frozen: "_Shape | None", root: float) -> "_Shape":
        """Integrate from the base, with the moment `root` of the loads there."""
        bending, distance = self.bending, self.distance

        def turn(s: float, y: ndarray, kappa: float) -> list[float]:
            sine, cosine = np.sin(y[0]), np.cos(y[0])
            down = self.load[1] + self.weight * (self.length - s)
            return [kappa, down * sine - self.load[0] * cosine]

        def sliding(s: float, y: ndarray) -> list[float]:
            kappa = (distance * y[2] + y[1]) / bending
            return [*turn(s, y, kappa), -sign * self.coefficient * y[2] * abs(kappa)]

        def sticking(s: float, y: ndarray) -> list[float]:
            return [*turn(s, y, frozen.curvature(np.array([s]))[0]), 0.0]

        def met(s: float, y: ndarray) -> float:
            kappa = (distance * y[2] + y[1]) / bending
            return sign * (kappa - frozen.curvature(np.array([s]))[0])

        options = {"method": "DOP853", "rtol": _RTOL, "atol": _ATOL, "dense_output": True}
        events = None
        if frozen is not None:
            met.terminal, met.direction, events = True, -1, met
        begin = [0.0, root, tension]
        first = solve_ivp(sliding, (0.0, self.length), begin, events=events, **options)
        front, rest = first.t[-1], None
        if front < self.length:
            rest = solve_ivp(sticking, (front, self.length), first.y[:, -1], **options).sol
        return _Shape(self, root, front, first.sol, rest, frozen)

    def _checked(self, shape: "_Shape", frozen: "_Shape | None") -> "_Shape":
        """Raises ValueError where what sticks would slide."""
        if frozen is None or shape.sticking is None:
            return shape
        s = shape.front + (self.length - shape.front) * _CHECKED
        step = 1e-4 * self.length * min(1 - shape.front / self.length, 0.1)
        s = s[(s > shape.front + step) & (s < self.length - step)]
        slope = (shape.tension(s + step) - shape.tension(s - step)) / (2 * step)
        most = self.coefficient * shape.tension(s) * np.abs(shape.curvature(s))
        # Differences across the fronts of earlier turns are smaller than the slopes beside them.
        if np.any(np.abs(slope) > most + max(_SLACK * most.max(), 1e-6 * np.abs(slope).max())):
            raise ValueError("the tendon slides beyond the place where it was to stick")
        return shape

    def _check_growth(self, before: Profile, now: Profile) -> None:
        """Raises ValueError unless all of the tendon was pulled in."""
        s = self.length * _CHECKED
        grown = np.cumsum((now(s) - before(s))[::-1])
        if np.any(grown < -1e-9 * np.abs(grown).max()):
            raise ValueError("not all of the tendon slides in while tension grows")


@dataclass(frozen=True)
class _Shape:
    """The rod at rest; its tendon slides up to `front` [m]."""

    rod: HangingRod
    root: float
    front: float
    sliding: Callable
    sticking: Callable | None
    frozen: "_Shape | None"

    def moment(self, s: ndarray) -> ndarray:
        """Of the loads (n,) [N m]."""
        return self._states(s)[1]

    def curvature(self, s: ndarray) -> ndarray:
        """(n,) [1/m]."""
        out = (self.rod.distance * self._states(s)[2] + self.moment(s)) / self.rod.bending
        beyond = s > self.front
        if self.frozen is not None and beyond.any():
            out[beyond] = self.frozen.curvature(s[beyond])
        return out

    def tension(self, s: ndarray) -> ndarray:
        """(n,) [N]."""
        return (self.rod.bending * self.curvature(s) - self.moment(s)) / self.rod.distance

    @property
    def angle(self) -> float:
        """[rad] of the tip."""
        return float(self._states(np.array([self.rod.length]))[0, 0])

    def _states(self, s: ndarray) -> ndarray:
        out = self.sliding(np.minimum(s, self.front))
        beyond = s > self.front
        if beyond.any():
            out[:, beyond] = self.sticking(s[beyond])
        return out
