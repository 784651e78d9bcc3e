"""Smooth closed paths of the tip, and runs along them from rest to rest.

They implement `trajectories.Trajectory`.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray
from numpy.linalg import norm

from softrobot_env.core.records import Count, Positive, check_fields

from .trajectories import Derivatives, quintic_step, ramped

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
        check_fields(self, "path")
        if len(self.cosine) != len(self.sine):
            raise ValueError(
                f"a path needs as many cosines as sines, got {len(self.cosine)} and "
                f"{len(self.sine)}"
            )
        if self.top_rate == 0:
            raise ValueError("a path needs a term that is not zero, it must not stay at its start")

    def derivative(self, phase: ndarray, order: int) -> ndarray:
        """Derivative (n, 3) [m] with respect to phi at phases (n,); order 0 is the point."""
        k = np.arange(1, len(self.cosine) + 1)
        terms = np.array(self.cosine) - 1j * np.array(self.sine)
        turn = np.exp(1j * np.asarray(phase))[..., None]
        turns = np.cumprod(np.broadcast_to(turn, (*turn.shape[:-1], len(k))), axis=-1)
        out = (turns @ ((1j * k[:, None]) ** order * terms)).real
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
        for points in (801, 101, 101):  # finer and finer grids
            grid = centre + width * np.linspace(-1, 1, points)
            rate = norm(self.derivative(grid, 1), axis=1)
            centre, width = grid[np.argmax(rate)], 4 * width / points
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
    farthest = norm(unit.derivative(np.linspace(0, 2 * np.pi, 2001), 0), axis=1).max()
    return FourierPath(start, *_points(terms / farthest @ np.array([along, across])))


def _points(terms: ndarray) -> list[tuple[Point, ...]]:
    """Arrays of points (m, n, 3) as tuples."""
    return [tuple(tuple(point) for point in group) for group in terms.tolist()]


@dataclass(frozen=True)
class SmoothRun:
    """Run a closed path, speeding up and slowing down smoothly, then rest.

    The rate of the phase rises and falls by the polynomial 10 t^3 - 15 t^4 + 6 t^5, so the
    acceleration is continuous, and is constant between.

    Attributes:
        curve: The path.
        speed: [m/s], largest speed at the constant rate; constant along a circle.
        laps: Number of times the path is run.
        ramp: [s] to speed up, and to slow down.
    """

    curve: FourierPath
    speed: float
    laps: Count = 1
    ramp: Positive = 0.5

    def __post_init__(self) -> None:
        check_fields(self, "run")
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

    def _phase(self, t: ndarray) -> Derivatives:
        """Phase [1], its rate [1/s] and acceleration [1/s2] at times t, each (n, 1)."""
        times = np.asarray(t, float)[..., None]
        return tuple(self.rate * x for x in ramped(times, self.end_time, self.ramp, quintic_step))

    def position(self, t: ndarray) -> ndarray:
        """Point on the path."""
        return self._along(t, 0)

    def velocity(self, t: ndarray) -> ndarray:
        """p' times the rate of the phase."""
        return self._along(t, 1) * self._phase(t)[1]

    def acceleration(self, t: ndarray) -> ndarray:
        """p'' times the squared rate of the phase, and p' times its acceleration."""
        _, rate, rising = self._phase(t)
        return self._along(t, 2) * rate**2 + self._along(t, 1) * rising

    def _along(self, t: ndarray, order: int) -> ndarray:
        return self.curve.derivative(self._phase(t)[0][..., 0], order)

    def path(self) -> ndarray:
        """One lap."""
        return self.curve.derivative(np.linspace(0, 2 * np.pi, 201), 0)
