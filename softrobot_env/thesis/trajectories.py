"""Reference trajectories of the spatial test rig (thesis secs. 5.4 and 6.1), as in `trajectories`.

Only x and y are references: the rig has two degrees of freedom, its height follows. The third
component is left zero. Both begin in the straight pose, on the axis.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from softrobot_env.core.records import Count, NotNegative, Positive, Record, Whole, check_fields
from softrobot_env.tasks.trajectories import Derivatives, cubic_step, quintic_step, ramped


class _Run:
    """A trajectory whose position and derivatives are computed at once."""

    def position(self, t: ndarray) -> ndarray:
        """Position (n, 3) [m] at times (n,) [s]."""
        return self._motion(t)[0]

    def velocity(self, t: ndarray) -> ndarray:
        """Velocity (n, 3) [m/s] at times (n,) [s]."""
        return self._motion(t)[1]

    def acceleration(self, t: ndarray) -> ndarray:
        """Acceleration (n, 3) [m/s2] at times (n,) [s]."""
        return self._motion(t)[2]

    def _motion(self, t: ndarray) -> Derivatives:
        raise NotImplementedError


@dataclass(frozen=True)
class RoundedTriangle(Record, _Run, what="triangle"):
    """Laps of a triangle with rounded corners, clockwise, (5.40) with the audit's corrections.

    z = (b1 cos 2 pi w + b1/4 cos 4 pi w, -b1 sin 2 pi w + b1/4 sin 4 pi w), w counting laps. From
    the straight pose to the first corner on a straight line, then speeding up during one lap of
    two periods, the laps at the constant rate, and one lap of two periods slowing down. Twice
    continuously differentiable.

    Attributes:
        b1: [m]; the corners are 1.25 b1 from the centre.
        period: [s] of a lap.
        laps: Laps at the constant rate.
        approach: [s] from the straight pose to the first corner; 0 starts there.
    """

    b1: Positive = 0.07
    period: Positive = 5.0
    laps: Whole = 3
    approach: NotNegative = 10.0

    @property
    def end_time(self) -> float:
        """Time [s] at which the run comes to rest."""
        return self.approach + (self.laps + 4) * self.period

    def path(self) -> ndarray:
        """The straight line and one lap."""
        lap = self._curve(np.linspace(0, 1, 201), 0)
        return lap if self.approach == 0 else np.concatenate((np.zeros((1, 3)), lap))

    def _motion(self, t: ndarray) -> Derivatives:
        t = np.asarray(t, float)
        w, rate, rise = (x[..., None] for x in self._laps(t - self.approach))
        first, second = self._curve(w[..., 0], 1), self._curve(w[..., 0], 2)
        on_lap = self._curve(w[..., 0], 0), rate * first, rate**2 * second + rise * first
        if self.approach == 0:
            return on_lap
        corner = self._curve(np.zeros(1), 0)[0]
        straight = [x[..., None] * corner for x in _rise(t, self.approach)]
        early = (t < self.approach)[..., None]
        return tuple(np.where(early, a, b) for a, b in zip(straight, on_lap, strict=True))

    def _laps(self, t: ndarray) -> Derivatives:
        """Number of laps w(t) done, its rate [1/s] and acceleration [1/s2]."""
        run = ramped(t, (self.laps + 4) * self.period, 2 * self.period, cubic_step)
        return tuple(x / self.period for x in run)

    def _curve(self, w: ndarray, order: int) -> ndarray:
        """Derivative of the path with respect to w, (n, 3) [m] for w of shape (n,)."""
        turn = 2j * np.pi
        # z_x + i z_y
        once = self.b1 * (-turn) ** order * np.exp(-turn * w)
        twice = self.b1 / 4 * (2 * turn) ** order * np.exp(2 * turn * w)
        return _in_plane(once + twice)


@dataclass(frozen=True)
class LapCircle(_Run):
    """From the straight pose out to a circle, a lap counter-clockwise, and back (audit sec. 4).

    Out and back by the smooth step 10 s^3 - 15 s^4 + 6 s^5. With `ramp` 0 the lap starts and stops
    with a jump of the velocity, as in the thesis; otherwise it speeds up and slows down smoothly.

    Attributes:
        radius: [m].
        speed: [m/s] along the circle.
        approach: [s] out, and back.
        ramp: [s] to speed up, and to slow down.
        laps: Number of laps.
    """

    radius: Positive = 0.12
    speed: Positive = 0.05
    approach: Positive = 10.0
    ramp: NotNegative = 0.0
    laps: Count = 1

    def __post_init__(self) -> None:
        check_fields(self, "circle")
        longest = 2 * np.pi * self.radius * self.laps / self.speed
        if not self.ramp <= longest:
            raise ValueError(f"circle: ramp must lie in [0, {longest:.3g}] s, got {self.ramp} s")

    @property
    def rate(self) -> float:
        """Angular velocity [1/s] between the ramps."""
        return self.speed / self.radius

    @property
    def lap_time(self) -> tuple[float, float]:
        """Times [s] at which the laps begin and end."""
        length = 2 * np.pi * self.laps / self.rate + self.ramp
        return self.approach, self.approach + length

    @property
    def end_time(self) -> float:
        """Time [s] at which the rig is straight again."""
        return self.lap_time[1] + self.approach

    def path(self) -> ndarray:
        """The straight line and one lap."""
        lap = self.radius * np.exp(2j * np.pi * np.linspace(0, 1, 201))
        return _in_plane(np.concatenate(([0.0], lap)))

    def _motion(self, t: ndarray) -> Derivatives:
        """With r(t) exp(i phi(t)), where either r or phi moves."""
        t = np.asarray(t, float)
        out, back = _rise(t, self.approach), _rise(self.end_time - t, self.approach)
        share, speed, push = np.minimum(out[0], back[0]), out[1] - back[1], out[2] + back[2]
        phase, rate, rise = self._phase(t)
        unit = self.radius * np.exp(1j * phase)
        position, velocity = share * unit, (speed + 1j * rate) * unit
        return tuple(
            _in_plane(x) for x in (position, velocity, (push + 1j * rise - rate**2) * unit)
        )

    def _phase(self, t: ndarray) -> Derivatives:
        begin, end = self.lap_time
        if self.ramp:
            run = ramped(t - begin, end - begin, self.ramp, quintic_step)
        else:
            run = np.clip(t, begin, end) - begin, (t >= begin) & (t < end), np.zeros_like(t)
        return tuple(self.rate * x for x in run)


def _in_plane(z: ndarray) -> ndarray:
    """Complex numbers x + i y (n,) as points (n, 3) at height 0."""
    return np.stack([z.real, z.imag, np.zeros_like(z.real)], axis=-1)


def _rise(t: ndarray, duration: float) -> Derivatives:
    """Smooth step from 0 to 1 during [0, duration], with its derivatives by time."""
    s = np.clip(t / duration, 0, 1)
    _, value, rate = quintic_step(s)
    return value, rate / duration, 60 * s * (1 - s) * (1 - 2 * s) / duration**2
