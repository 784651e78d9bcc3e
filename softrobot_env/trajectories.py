"""Reference trajectories of the tip: time -> position, velocity, acceleration.

Every trajectory answers `position(t)`, `velocity(t)` and `acceleration(t)` for times of shape
(n,) [s] with arrays (n, 3) [m, m/s, m/s2], is constant outside its motion, and gives the path it
follows as points (k, 3) [m]. Where a trajectory has a kink (thesis sec. 6.6.1), velocity and
acceleration are those just after it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np


class Trajectory(Protocol):
    """What tasks need of a trajectory."""

    def position(self, t: np.ndarray) -> np.ndarray:
        """Position (n, 3) [m] at times (n,) [s]."""

    def velocity(self, t: np.ndarray) -> np.ndarray:
        """Velocity (n, 3) [m/s] at times (n,) [s]."""

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        """Acceleration (n, 3) [m/s2] at times (n,) [s]."""

    def path(self) -> np.ndarray:
        """Points (k, 3) [m] on the path, in order, for drawing."""


def _constant(value: tuple[float, float, float], t: np.ndarray) -> np.ndarray:
    return np.broadcast_to(value, (*np.shape(t), 3)).astype(float)


@dataclass(frozen=True)
class Step:
    """Jump from `start` to `target`, both (3,) [m], at time 0."""

    start: tuple[float, float, float]
    target: tuple[float, float, float]

    def position(self, t: np.ndarray) -> np.ndarray:
        """Start before time 0, target from time 0 on."""
        before = np.asarray(t)[..., None] < 0
        return np.where(before, self.start, self.target)

    def velocity(self, t: np.ndarray) -> np.ndarray:
        """Zero: the jump itself has no finite velocity."""
        return _constant((0.0, 0.0, 0.0), t)

    acceleration = velocity

    def path(self) -> np.ndarray:
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
        if len(self.waypoints) != len(self.times) or np.any(np.diff(self.times) <= 0):
            raise ValueError("a polyline needs one increasing time per waypoint")

    def position(self, t: np.ndarray) -> np.ndarray:
        """Linear between the waypoints."""
        points = np.array(self.waypoints)
        return np.stack([np.interp(t, self.times, points[:, i]) for i in range(3)], axis=-1)

    def velocity(self, t: np.ndarray) -> np.ndarray:
        """Constant on each leg, zero outside."""
        leg = np.searchsorted(self.times, t, side="right")
        speed = np.diff(self.waypoints, axis=0) / np.diff(self.times)[:, None]
        return np.concatenate((np.zeros((1, 3)), speed, np.zeros((1, 3))))[leg]

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        """Zero: all acceleration is in the kinks."""
        return _constant((0.0, 0.0, 0.0), t)

    def path(self) -> np.ndarray:
        """The waypoints."""
        return np.array(self.waypoints)


#: Gauss nodes on each third; the tangent turns by at most 2 rad there.
_NODES = 8


@dataclass(frozen=True)
class EqualForceCurve:
    """Tip curve c(a) of the planar arm when its three tendon pairs pull alike (audit sec. 4).

    The curvature is a * (3, 2, 1) [1/m] on the three thirds, a = F r_t / EI.

    Attributes:
        length: [m] of the arm.
    """

    length: float

    @cached_property
    def _quadrature(self) -> tuple[np.ndarray, np.ndarray]:
        """Weights and g(s), the tangent angle per unit a, at Gauss nodes on each third."""
        x, w = np.polynomial.legendre.leggauss(_NODES)
        third = self.length / 3
        local = third * (x + 1) / 2
        angle = np.array([3 * local, 3 * third + 2 * local, 5 * third + local])
        return np.tile(w * third / 2, 3), angle.ravel()

    def derivative(self, a: np.ndarray, order: int) -> np.ndarray:
        """Derivative of the tip with respect to a, order 0 to 2: (n, 3) for a of shape (n,)."""
        weights, angle = self._quadrature
        # z + i x is the integral of exp(i a g(s)) along the arm.
        z = (1j * angle) ** order * np.exp(1j * np.multiply.outer(a, angle)) @ weights
        return np.stack([z.imag, np.zeros_like(z.imag), z.real], axis=-1)

    def parameter_at_distance(self, start: float, distance: float, limit: float = 1.7) -> float:
        """Parameter a > start whose tip lies `distance` [m] (Euclidean) from that of `start`.

        Raises:
            ValueError: The curve up to parameter `limit` does not reach that far.
        """
        grid = np.linspace(start, limit, 2001)
        reach = np.linalg.norm(self.derivative(grid, 0) - self.derivative(start, 0), axis=1)
        if not 0 < distance <= reach[-1]:
            raise ValueError(
                f"step width must lie in (0, {1e3 * reach[-1]:.0f}] mm, got {1e3 * distance:g} mm"
            )
        a = np.interp(distance, reach, grid)
        for _ in range(3):  # Newton; the table is already good to 1e-7
            gap = self.derivative(a, 0) - self.derivative(start, 0)
            size = np.linalg.norm(gap)
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
        longest = self._table[0][-1]
        if not 0 < self.half_length <= longest or not 0 < self.speed < np.inf:
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
    def _table(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Arc length [m], curve parameter a and da/ds on a grid, odd about its middle."""
        a = np.linspace(-2.0, 2.0, 101)
        x, w = np.polynomial.legendre.leggauss(4)
        step = a[1] - a[0]
        nodes = a[:-1, None] + step * (x + 1) / 2
        arc = np.concatenate(([0.0], np.cumsum(self._rate(nodes) @ w * step / 2)))
        return arc - arc[len(a) // 2], a, 1 / self._rate(a)

    def _rate(self, a: np.ndarray) -> np.ndarray:
        return np.linalg.norm(self.curve.derivative(a, 1), axis=-1)

    def _parameter(self, t: np.ndarray) -> np.ndarray:
        """Curve parameter at times t: the table, inverted by cubic Hermite interpolation."""
        arc, a, slope = self._table
        moved = np.clip(self.speed * np.asarray(t), 0, 2 * self.half_length) - self.half_length
        i = np.clip(np.searchsorted(arc, moved), 1, len(arc) - 1)
        size = arc[i] - arc[i - 1]
        u = (moved - arc[i - 1]) / size
        left = (1 - u) ** 2 * ((1 + 2 * u) * a[i - 1] + u * size * slope[i - 1])
        right = u**2 * ((3 - 2 * u) * a[i] - (1 - u) * size * slope[i])
        return left + right

    def _moving(self, t: np.ndarray) -> np.ndarray:
        t = np.asarray(t)
        return ((t >= 0) & (t < self.end_time))[..., None]

    def position(self, t: np.ndarray) -> np.ndarray:
        """Point on the curve, from (-x, z) through the straight pose to (x, z)."""
        return self.curve.derivative(self._parameter(t), 0)

    def velocity(self, t: np.ndarray) -> np.ndarray:
        """Speed times the unit tangent while moving."""
        tangent = self.curve.derivative(self._parameter(t), 1)
        unit = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
        return np.where(self._moving(t), self.speed * unit, 0.0)

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        """Squared speed times the curvature vector of the path while moving."""
        a = self._parameter(t)
        first, second = self.curve.derivative(a, 1), self.curve.derivative(a, 2)
        squared = np.sum(first**2, axis=-1, keepdims=True)
        along = np.sum(first * second, axis=-1, keepdims=True)
        bend = (second - first * along / squared) / squared
        return np.where(self._moving(t), self.speed**2 * bend, 0.0)

    def path(self) -> np.ndarray:
        """Points every 10 mm of arc length."""
        count = int(np.ceil(2 * self.half_length / 0.01)) + 1
        return self.position(np.linspace(0.0, self.end_time, count))


Point = tuple[float, float, float]


@dataclass(frozen=True)
class FourierPath:
    """Closed path p(phi) = start + sum over k = 1, 2, ... of c_k (cos k phi - 1) + s_k sin k phi.

    It begins and ends at `start`, at phi = 0 and 2 pi.

    Attributes:
        start: (3,) [m].
        cosine, sine: (n, 3) [m], c_k and s_k.
    """

    start: Point
    cosine: tuple[Point, ...]
    sine: tuple[Point, ...]

    def __post_init__(self) -> None:
        shapes = np.shape(self.cosine), np.shape(self.sine)
        if np.shape(self.start) != (3,) or shapes[0] != shapes[1] or shapes[0][1:] != (3,):
            raise ValueError(
                "a path needs a start (3,) and as many cosines as sines, each (n, 3), got "
                f"{np.shape(self.start)}, {shapes[0]} and {shapes[1]}"
            )
        if self.top_rate == 0:
            raise ValueError("a path needs a term that is not zero, it must not stay at its start")

    def derivative(self, phase: np.ndarray, order: int) -> np.ndarray:
        """Derivative (n, 3) [m] with respect to phi at phases (n,); order 0 is the point."""
        k = np.arange(1, len(self.cosine) + 1)
        terms = np.array(self.cosine) - 1j * np.array(self.sine)
        out = (np.exp(1j * np.multiply.outer(phase, k)) @ ((1j * k[:, None]) ** order * terms)).real
        return out + self.start - np.sum(self.cosine, axis=0) if order == 0 else out

    def mirrored(self) -> "FourierPath":
        """The same path on the other side of the plane x = 0."""
        flip = np.array([-1.0, 1.0, 1.0])
        start = tuple((flip * self.start).tolist())
        return FourierPath(start, *_points(flip * np.array([self.cosine, self.sine])))

    @cached_property
    def top_rate(self) -> float:
        """Largest |p'| [m]: the speed per rate of the phase where the path is fastest."""
        centre, width = np.pi, np.pi
        for _ in range(3):  # finer and finer grids
            grid = centre + width * np.linspace(-1, 1, 2001)
            rate = np.linalg.norm(self.derivative(grid, 1), axis=1)
            centre, width = grid[np.argmax(rate)], width / 500
        return float(rate.max())


def circle(start: Point, centre: Point) -> FourierPath:
    """Circle in the x-z plane, from `start` about `centre`, first turning from +z to +x."""
    x, z = start[0] - centre[0], start[2] - centre[2]
    return FourierPath(start, ((x, 0.0, z),), ((z, 0.0, -x),))


def figure_eight(centre: Point, along: Point, across: Point) -> FourierPath:
    """Lissajous figure centre + along sin phi + across sin 2 phi, from its crossing.

    Args:
        centre: (3,) [m], the crossing.
        along, across: (3,) [m], from the crossing to an end and to the height of a lobe.
    """
    return FourierPath(centre, ((0.0, 0.0, 0.0),) * 2, (along, across))


def random_path(
    seed: int, start: Point, along: Point, across: Point, harmonics: int = 6
) -> FourierPath:
    """Smooth random closed path that just fills an ellipse about its start.

    The amplitudes of the harmonics k are normal, with standard deviations that fall as 1 / k.

    Args:
        seed: Whole number, zero or more; the same path from the same seed.
        start: (3,) [m], centre of the ellipse.
        along, across: (3,) [m], semi-axes of the ellipse.
        harmonics: Number of harmonics.

    Raises:
        ValueError: The seed is not a whole number of zero or more.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"the seed of a path must be a whole number >= 0, got {seed!r}")
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    terms = rng.normal(size=(2, harmonics, 2)) / np.arange(1, harmonics + 1)[:, None]
    unit = FourierPath((0.0, 0.0, 0.0), *_points(np.insert(terms, 2, 0.0, axis=-1)))
    farthest = np.linalg.norm(unit.derivative(np.linspace(0, 2 * np.pi, 2001), 0), axis=1).max()
    return FourierPath(start, *_points(terms / farthest @ np.array([along, across])))


def _points(terms: np.ndarray) -> list[tuple[Point, ...]]:
    """Arrays of points (m, n, 3) as tuples."""
    return [tuple(tuple(point) for point in group) for group in terms.tolist()]


@dataclass(frozen=True)
class SmoothRun:
    """Run a closed path, speeding up and slowing down smoothly, then rest.

    The rate of the phase rises and falls by the polynomial 10 t^3 - 15 t^4 + 6 t^5, so the
    acceleration is continuous, and is constant between.

    Attributes:
        curve: The path.
        speed: [m/s] where the path is fastest at the constant rate; all along a circle.
        laps: Number of times the path is run.
        ramp: [s] to speed up, and to slow down.
    """

    curve: FourierPath
    speed: float
    laps: int = 1
    ramp: float = 0.5

    def __post_init__(self) -> None:
        if self.laps < 1 or not 0 < self.ramp < np.inf:
            raise ValueError(
                f"a run needs one lap or more and a positive ramp, got {self.laps} laps and "
                f"{self.ramp} s"
            )
        fastest = self._way * self.curve.top_rate / self.ramp
        if not 0 < self.speed <= fastest:
            raise ValueError(
                f"the speed of this run must lie in (0, {fastest:.3g}] m/s, got {self.speed!r}"
            )

    @property
    def _way(self) -> float:
        return 2 * np.pi * self.laps

    @property
    def rate(self) -> float:
        """Rate of the phase [1/s] between the ramps."""
        return self.speed / self.curve.top_rate

    @property
    def end_time(self) -> float:
        """Time [s] at which the run comes to rest."""
        return self._way / self.rate + self.ramp

    def _phase(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Phase [1], its rate [1/s] and acceleration [1/s2] at times t, each (n, 1)."""
        t = np.asarray(t, dtype=float)[..., None]
        left = self.end_time - t
        up, down = np.clip(t / self.ramp, 0, 1), np.clip(left / self.ramp, 0, 1)
        steady = np.clip(t, self.ramp, self.end_time - self.ramp) - self.ramp
        moved = steady + self.ramp * (_ramp_integral(up) + 0.5 - _ramp_integral(down))
        rising = 30 * up**2 * (1 - up) ** 2 - 30 * down**2 * (1 - down) ** 2
        rate = np.minimum(_ramp(up), _ramp(down))
        return self.rate * moved, self.rate * rate, self.rate * rising / self.ramp

    def position(self, t: np.ndarray) -> np.ndarray:
        """Point on the path."""
        return self._along(t, 0)

    def velocity(self, t: np.ndarray) -> np.ndarray:
        """p' times the rate of the phase."""
        return self._along(t, 1) * self._phase(t)[1]

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        """p'' times the squared rate of the phase, and p' times its acceleration."""
        _, rate, rising = self._phase(t)
        return self._along(t, 2) * rate**2 + self._along(t, 1) * rising

    def _along(self, t: np.ndarray, order: int) -> np.ndarray:
        return self.curve.derivative(self._phase(t)[0][..., 0], order)

    def path(self) -> np.ndarray:
        """One lap."""
        return self.curve.derivative(np.linspace(0, 2 * np.pi, 201), 0)


def _ramp(share: np.ndarray) -> np.ndarray:
    """Smooth step from 0 to 1 with two derivatives that vanish at its ends."""
    return share**3 * (10 - 15 * share + 6 * share**2)


def _ramp_integral(share: np.ndarray) -> np.ndarray:
    return share**4 * (2.5 - 3 * share + share**2)
