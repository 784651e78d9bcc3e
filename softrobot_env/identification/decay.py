"""Damping of a rig, measured: it is bent, let go, and sways.

The rate of decay is compared with that of a simulated rig which is let go in the same way. Friction
makes the oscillation decay faster the smaller it is, damping does not: rates early and late tell
the one from the other. The amplitude, the place of rest, errors of the servos and the camera's
delay do not matter.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from softrobot_env.control.rig.inverse import TOTAL
from softrobot_env.identification.visits import (
    PERIOD,
    Visit,
    go,
    nominal_lengths,
    started,
    step,
    visit_duration,
)
from softrobot_env.robots import RIG, RobotParams
from softrobot_env.robots.twin import Twin, nominal_twin

#: Places from which the rig is let go: their number, and distance from the axis [m].
RELEASES, _AWAY = 3, 0.06

#: [s] from a release on. The first begins when the servos are there.
_WINDOWS = ((0.16, 0.8), (0.7, 1.6))
_END = 1.6

_VISIT = Visit()

#: Damping over that of the model [1] and friction [N] that are looked for: bounds, and start, which
#: does not matter (a test has three times this friction).
LARGEST, _GUESS = (5.0, 1.0), (1.2, 0.05)

#: Largest error of the rates [1].
_CLOSE = 0.02

#: Where the search for an oscillation starts: rate of decay [1/s] and frequency [rad/s] (audit).
_START = (2.2, 10.0)


def visit_decays(twin: Twin | int | None, seed: int = 0, count: int = RELEASES) -> np.ndarray:
    """Outputs (count, n, 2) [m] in control periods after the rig was let go.

    Args:
        twin: See `RigEnv`.
        seed: Of the noise.
        count: Number of releases, from places all round.
    """
    angle = 2 * np.pi * np.arange(count) / count
    places = _AWAY * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    away, home = nominal_lengths(RIG, places, TOTAL), nominal_lengths(RIG, np.zeros((1, 2)), TOTAL)
    samples = round(_END / PERIOD)
    env = started(twin, visit_duration(_VISIT, count) + count * _END, seed)
    away, home = away / env.length_scale, home[0] / env.length_scale
    now, found = np.zeros_like(home), np.empty((count, samples, 2))
    for record, there in zip(found, away, strict=True):
        go(env, now, there, _VISIT)
        record[:] = [step(env, home.astype(np.float32)) for _ in range(samples)]
        now = home
    return found


def rates_of_decay(outputs: np.ndarray) -> np.ndarray:
    """Mean rates (2,) [1/s] at which oscillations (k, n, 2) [m] die away, early and late."""
    return np.array([np.mean([_rate(one, *window) for one in outputs]) for window in _WINDOWS])


def _rate(record: np.ndarray, begin: float, end: float) -> float:
    """Rate [1/s] of a record (n, 2), by least squares of c + exp(-rate t) (a cos + b sin)."""
    time = PERIOD * np.arange(1, len(record) + 1)
    used = (time >= begin) & (time <= end)
    record, time = record[used], time[used, None]

    def missing(parameters: np.ndarray) -> np.ndarray:
        rate, frequency = parameters
        wave = np.exp((1j * frequency - rate) * time)
        parts = np.hstack([np.ones_like(time), wave.real, wave.imag])
        return (record - parts @ np.linalg.lstsq(parts, record)[0]).ravel() / _AWAY

    return float(least_squares(missing, _START, x_scale=_START).x[0])


def damping_of(outputs: np.ndarray, believed: RobotParams) -> tuple[float, float]:
    """Damping over that of a robot [1], and friction [N] of each tendon, of a rig let go.

    Args:
        outputs: (k, n, 2) [m], see `visit_decays`.
        believed: The rig as it seems to be, but for these two.

    Raises:
        ValueError: None within `LARGEST` lets it decay as measured.
    """
    wanted = rates_of_decay(outputs)

    def off(parameters: np.ndarray) -> np.ndarray:
        damping, friction = parameters
        rubbing = tuple(replace(tendon, friction=friction) for tendon in believed.tendons)
        rig = replace(believed, damping_time=damping * believed.damping_time, tendons=rubbing)
        decays = visit_decays(nominal_twin(rig), count=len(outputs))
        return rates_of_decay(decays) / wanted - 1

    found = least_squares(
        off,
        _GUESS,
        bounds=([0, 0], LARGEST),
        x_scale=_GUESS,
        diff_step=0.05,
        xtol=1e-4,
        max_nfev=12,
    )
    if not np.abs(found.fun).max() < _CLOSE:
        raise ValueError(
            f"no damping up to {LARGEST[0]:g} times that of the model with up to {LARGEST[1]:g} N "
            f"of friction in each tendon decays at {wanted.round(2).tolist()} 1/s"
        )
    return float(found.x[0]), float(found.x[1])
