"""Reference trajectories of the tip: time -> position, velocity, acceleration.

Every trajectory returns `position(t)`, `velocity(t)` and `acceleration(t)` for times of shape (n,)
[s] as arrays (n, 3) [m, m/s, m/s2], is constant outside its motion, and gives its path as points
(k, 3) [m]. Where a trajectory has a kink (thesis sec. 6.6.1), velocity and acceleration are those
just after it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy import ndarray
from numpy.linalg import norm

from softrobot_env.core.records import Positive, Record, check_fields


@runtime_checkable
class Trajectory(Protocol):
    """Interface of trajectories."""

    def position(self, t: ndarray) -> ndarray:
        """Position (n, 3) [m] at times (n,) [s]."""

    def velocity(self, t: ndarray) -> ndarray:
        """Velocity (n, 3) [m/s] at times (n,) [s]."""

    def acceleration(self, t: ndarray) -> ndarray:
        """Acceleration (n, 3) [m/s2] at times (n,) [s]."""

    def path(self) -> ndarray:
        """Points (k, 3) [m] on the path, in order, for drawing."""


class Jumping:
    """A trajectory that is constant between jumps."""

    def velocity(self, t: ndarray) -> ndarray:
        """Zero: a jump itself has no finite velocity."""
        return np.zeros((*np.shape(t), 3))

    acceleration = velocity


@dataclass(frozen=True)
class Step(Record, Jumping):
    """Jump from `start` to `target`, both (3,) [m], at time 0."""

    start: tuple[float, float, float]
    target: tuple[float, float, float]

    def position(self, t: ndarray) -> ndarray:
        """Start before time 0, target from time 0 on."""
        return np.where(np.asarray(t)[..., None] < 0, self.start, self.target)

    def path(self) -> ndarray:
        """The two end points."""
        return np.array([self.start, self.target])


@dataclass(frozen=True)
class Polyline:
    """Straight legs between waypoints at constant speed per leg, then at rest.

    Attributes:
        waypoints: (k, 3) [m].
        times: (k,) [s] at which the waypoints are passed, increasing.
    """

    waypoints: tuple[tuple[float, float, float], ...]
    times: tuple[float, ...]

    def __post_init__(self) -> None:
        check_fields(self, "polyline")
        if len(self.waypoints) != len(self.times) or np.any(np.diff(self.times) <= 0):
            raise ValueError("a polyline needs one increasing time per waypoint")

    def position(self, t: ndarray) -> ndarray:
        """Linear between the waypoints."""
        points = np.array(self.waypoints)
        return np.stack([np.interp(t, self.times, points[:, i]) for i in range(3)], axis=-1)

    def velocity(self, t: ndarray) -> ndarray:
        """Constant on each leg, zero outside."""
        leg = np.searchsorted(self.times, t, side="right")
        speed = np.diff(self.waypoints, axis=0) / np.diff(self.times)[:, None]
        return np.concatenate((np.zeros((1, 3)), speed, np.zeros((1, 3))))[leg]

    def acceleration(self, t: ndarray) -> ndarray:
        """Zero: all acceleration is in the kinks."""
        return np.zeros((*np.shape(t), 3))

    def path(self) -> ndarray:
        """The waypoints."""
        return np.array(self.waypoints)


#: Gauss nodes on each third; the tangent turns by at most 2 rad there.
_NODES = 8

#: Largest parameter of an equal-force curve [1/m] in the search for steps.
_LARGEST = 1.7


@dataclass(frozen=True)
class EqualForceCurve(Record, what="equal-force curve"):
    """Tip curve c(a) of the planar arm when its three tendon pairs pull equally (audit sec. 4).

    The curvature is a * (3, 2, 1) [1/m] on the three thirds, a = F r_t / EI.

    Attributes:
        length: [m] of the arm.
    """

    length: Positive

    @cached_property
    def _quadrature(self) -> tuple[ndarray, ndarray]:
        """Weights and g(s), the tangent angle per unit a, at Gauss nodes on each third."""
        x, w = np.polynomial.legendre.leggauss(_NODES)
        third = self.length / 3
        local = third * (x + 1) / 2
        angle = np.array([3 * local, 3 * third + 2 * local, 5 * third + local])
        return np.tile(w * third / 2, 3), angle.ravel()

    def derivative(self, a: ndarray, order: int) -> ndarray:
        """Derivative of the tip with respect to a, order 0 to 2: (n, 3) for a of shape (n,)."""
        weights, angle = self._quadrature
        # z + i x is the integral of exp(i a g(s)) along the arm.
        z = (1j * angle) ** order * np.exp(1j * np.multiply.outer(a, angle)) @ weights
        return np.stack([z.imag, np.zeros_like(z.imag), z.real], axis=-1)

    def parameter_at_distance(self, start: float, distance: float) -> float:
        """Parameter a > start whose tip lies `distance` [m] (Euclidean) from that of `start`.

        Raises:
            ValueError: The curve up to the parameter `_LARGEST` does not reach that far.
        """
        grid = np.linspace(start, _LARGEST, 2001)
        reach = norm(self.derivative(grid, 0) - self.derivative(start, 0), axis=1)
        if not 0 < distance <= reach[-1]:
            raise ValueError(
                f"step width must lie in (0, {1e3 * reach[-1]:.0f}] mm, got {1e3 * distance:g} mm"
            )
        a = np.interp(distance, reach, grid)
        for _ in range(3):  # Newton; the table is already good to 1e-7
            gap = self.derivative(a, 0) - self.derivative(start, 0)
            size = norm(gap)
            a -= (size - distance) * size / (gap @ self.derivative(a, 1))
        return float(a)


@dataclass(frozen=True)
class CurveSweep:
    """Run along an equal-force curve at constant speed, then rest.

    Attributes:
        curve: The curve.
        half_length: [m], arc length from the straight pose to either end.
        speed: [m/s].
    """

    curve: EqualForceCurve
    half_length: float
    speed: float

    def __post_init__(self) -> None:
        check_fields(self, "sweep")
        longest = self._table[0][-1]
        if not 0 < self.half_length <= longest or not self.speed > 0:
            raise ValueError(
                f"a sweep needs a positive speed and a half length in (0, {longest:.3f}] m, got "
                f"{self.speed} m/s and {self.half_length} m"
            )

    @property
    def end_time(self) -> float:
        """Time [s] at which the far end is reached."""
        return 2 * self.half_length / self.speed

    @property
    def start_parameter(self) -> float:
        """Curve parameter a [1/m] at time 0."""
        return float(self._parameter(np.zeros(1))[0])

    @cached_property
    def _table(self) -> tuple[ndarray, ndarray, ndarray]:
        """Arc length [m], curve parameter a and da/ds on a grid, odd about its middle."""
        a = np.linspace(-2.0, 2.0, 101)
        x, w = np.polynomial.legendre.leggauss(4)
        step = a[1] - a[0]
        nodes = a[:-1, None] + step * (x + 1) / 2
        arc = np.concatenate(([0.0], np.cumsum(self._rate(nodes) @ w * step / 2)))
        return arc - arc[len(a) // 2], a, 1 / self._rate(a)

    def _rate(self, a: ndarray) -> ndarray:
        return norm(self.curve.derivative(a, 1), axis=-1)

    def _parameter(self, t: ndarray) -> ndarray:
        """Curve parameter at times t: the table, inverted by cubic Hermite interpolation."""
        arc, a, slope = self._table
        moved = np.clip(self.speed * np.asarray(t), 0, 2 * self.half_length) - self.half_length
        i = np.clip(np.searchsorted(arc, moved), 1, len(arc) - 1)
        size = arc[i] - arc[i - 1]
        u = (moved - arc[i - 1]) / size
        left = (1 - u) ** 2 * ((1 + 2 * u) * a[i - 1] + u * size * slope[i - 1])
        right = u**2 * ((3 - 2 * u) * a[i] - (1 - u) * size * slope[i])
        return left + right

    def _moving(self, t: ndarray) -> ndarray:
        t = np.asarray(t)
        return ((t >= 0) & (t < self.end_time))[..., None]

    def position(self, t: ndarray) -> ndarray:
        """Point on the curve, from (-x, z) through the straight pose to (x, z)."""
        return self.curve.derivative(self._parameter(t), 0)

    def velocity(self, t: ndarray) -> ndarray:
        """Speed times the unit tangent while moving."""
        tangent = self.curve.derivative(self._parameter(t), 1)
        unit = tangent / norm(tangent, axis=-1, keepdims=True)
        return np.where(self._moving(t), self.speed * unit, 0.0)

    def acceleration(self, t: ndarray) -> ndarray:
        """Squared speed times the curvature vector of the path while moving."""
        a = self._parameter(t)
        first, second = self.curve.derivative(a, 1), self.curve.derivative(a, 2)
        squared = np.sum(first**2, axis=-1, keepdims=True)
        along = np.sum(first * second, axis=-1, keepdims=True)
        bend = (second - first * along / squared) / squared
        return np.where(self._moving(t), self.speed**2 * bend, 0.0)

    def path(self) -> ndarray:
        """Points every 10 mm of arc length."""
        count = int(np.ceil(2 * self.half_length / 0.01)) + 1
        return self.position(np.linspace(0.0, self.end_time, count))


@dataclass(frozen=True)
class SetPoints(Jumping):
    """Jumps from one point to the next, each held for a while.

    Attributes:
        points: (k, 3) [m].
        hold: [s] at each point; the last one stays.
    """

    jumps: ClassVar[bool] = True

    points: tuple[tuple[float, float, float], ...]
    hold: Positive

    def __post_init__(self) -> None:
        check_fields(self, "set points")
        if not self.points:
            raise ValueError("set points need one point or more")

    def position(self, t: ndarray) -> ndarray:
        """Position (n, 3) [m] at times (n,) [s]; at a jump the new point."""
        index = np.floor(np.asarray(t) / self.hold + 1e-9).astype(int)
        return np.array(self.points)[np.clip(index, 0, len(self.points) - 1)]

    def path(self) -> ndarray:
        """The points."""
        return np.array(self.points)


# ---------------------------------------------------------------- smooth steps

#: Value of a function of time and its first two derivatives by time.
Derivatives = tuple[ndarray, ndarray, ndarray]


def cubic_step(s: ndarray) -> Derivatives:
    """Integral, value and slope of the step 3 s^2 - 2 s^3 from 0 to 1, for s in [0, 1]."""
    return s**3 - s**4 / 2, s**2 * (3 - 2 * s), 6 * s * (1 - s)


def quintic_step(s: ndarray) -> Derivatives:
    """Like `cubic_step`: 10 s^3 - 15 s^4 + 6 s^5, whose second derivative vanishes at the ends."""
    value = s**3 * (10 - 15 * s + 6 * s**2)
    return s**4 * (2.5 - 3 * s + s**2), value, 30 * s**2 * (1 - s) ** 2


def ramped(
    t: ndarray, duration: float, ramp: float, step: Callable[[ndarray], Derivatives]
) -> Derivatives:
    """Progress [s] of a run from rest to rest at times t, its rate [1] and acceleration [1/s].

    The rate rises from 0 to 1 in the first `ramp` [s] of the `duration` [s] by `step`, and falls
    likewise in the last; the total progress is `duration - ramp`.
    """
    up, down = (step(np.clip(x / ramp, 0, 1)) for x in (t, duration - t))
    steady = np.clip(t, ramp, duration - ramp) - ramp
    done = steady + ramp * (up[0] + 0.5 - down[0])
    return done, np.minimum(up[1], down[1]), (up[2] - down[2]) / ramp
