"""How much light passes a joint of fibres, how it becomes numbers, and what is built otherwise.

Planar sensor: the thesis gives no f of (4.1). With two equal angles the light is f(alpha / 2)^2,
and the thesis' polynomial of order 5 (Tab. 4.1) says how that depends on alpha, from the darkest
(0 %) to the lightest (100 %); how dark the darkest is, r_0 = 0.08, the audit inferred from the
errors at unequal angles. Beyond 30 degrees, where there are no measurements, f falls linearly to
zero at twice the acceptance angle, where no ray that leaves a fibre is kept by the next.
"""

from collections.abc import Sequence
from functools import cache
from math import radians
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.robots.sensors import ACCEPTANCE, OUTPUTS, Sensor

#: Polynomial of order 5: alpha [degrees] by the relative current [%], Tab. 4.1.
POLYNOMIAL = (60.2, -0.952, 0.0187, -4.08e-4, 4.54e-6, -1.99e-8)

#: Light at 60 degrees over that when straight (audit, inferred).
DARK = 0.08

#: Largest angle [rad] of a joint that the thesis measured.
MEASURED = radians(30)

#: [LSB] between darkest and lightest (audit, inferred from 1.4 LSB and 0.09 degrees), and all the
#: converter has (T: 12 bit).
SPAN, CONVERTER = 1930.0, 4095.0

#: Tilt [rad] of outgoing fibres (T: 160 degrees between the fibres), and width of what they accept,
#: over the acceptance angle (audit, assumed): exp(-(psi / 20 degrees)^2).
TILT = radians(20)

#: [LSB] of a straight sensor, by kind. The resistor is chosen for 90 % of what the phototransistor
#: can give (T); a spatial sensor gives most when one pair of fibres is in line.
FULL = 0.9
STRAIGHT = {"planar": SPAN / (1 - DARK), "spatial": FULL * CONVERTER * float(np.exp(-1.0))}
SATURATED = {"planar": STRAIGHT["planar"] / FULL, "spatial": CONVERTER}

_TABLE = 2001  # angles of f's table


@cache
def _table() -> tuple[ndarray, ndarray]:
    """Angles [rad] of a joint up to the largest measured, and f there."""
    current = np.linspace(0.0, 1.0, 20_001)
    total = np.polynomial.Polynomial(POLYNOMIAL)(100 * current)
    angles = np.linspace(0.0, MEASURED, _TABLE)
    relative = np.interp(-2 * np.degrees(angles), -total, current)
    light = np.sqrt(DARK + (1 - DARK) * relative)
    return angles, light / light[0]


def transmission(angle: ndarray, acceptance: ndarray | float = ACCEPTANCE) -> ndarray:
    """f of (4.1): light kept at joints with angles (...) [rad], over that when straight."""
    angles, light = _table()
    beyond = light[-1] * (2 * acceptance - angle) / (2 * acceptance - MEASURED)
    inside = np.interp(angle, angles, light)
    kept = np.where(angle > MEASURED, np.clip(beyond, 0.0, light[-1]), inside)
    return np.where(angle >= 2 * acceptance, 0.0, kept)


def split_light(bend: ndarray, azimuth: ndarray, tilt: ndarray, acceptance: ndarray) -> ndarray:
    """Light (..., 4) in outgoing fibres of a spatial sensor, over that of fibres in line.

    Args:
        bend: (..., 2) [rad] of the joint, towards +x and +y.
        azimuth, tilt: (..., 4) [rad] of the outgoing fibres.
        acceptance: (..., 1) [rad].
    """
    size = np.hypot(bend[..., :1], bend[..., 1:])
    sine = np.sinc(size / np.pi)  # sin(size) / size
    towards = bend[..., :1] * np.cos(azimuth) + bend[..., 1:] * np.sin(azimuth)
    cosine = np.cos(size) * np.cos(tilt) - sine * towards * np.sin(tilt)
    return np.exp(-((np.arccos(np.clip(cosine, -1.0, 1.0)) / acceptance) ** 2))


#: Largest turn [rad] between two tags.
MOST_TURN = 4 * np.pi


def readings(sensors: Sequence[Sensor]) -> tuple[ndarray, ndarray]:
    """Least and largest readings (k,) of a robot's sensors, see `robots.sensors.Sensor`."""
    tags = np.array([s.kind == "tags" for s in sensors for _ in range(s.size)])
    most = [SATURATED.get(s.kind, 1.0) / STRAIGHT.get(s.kind, 1.0) for s in sensors]
    most = np.repeat(most, [s.size for s in sensors])
    return np.where(tags, -MOST_TURN, 0.0), np.where(tags, MOST_TURN, most * (1 + 1e-9))


# ---------------------------------------------------------------- specimens

#: Light of an infrared diode per temperature [1/K] (S; usual in data sheets), and the time [s] in
#: which a circuit warms up (S).
LIGHT_PER_KELVIN, WARMING_TIME = -0.005, 300.0

#: Time [s] in which a drift forgets (S).
DRIFT_TIME = 600.0

#: Radii [rad] of the play of the hysteresis, with equal weights (S).
PLAY = np.radians([0.5, 1.5, 4.0])


class Specimen(NamedTuple):
    """A built sensor; all ones and zeros of an ideal one.

    Attributes:
        gain: (size,) [1], of the light of each reading.
        moment_arm: (joints,) [1], angle of a joint over that of the shape.
        tilt, azimuth: (4,) [rad], of outgoing fibres.
        acceptance: [rad].
    """

    gain: ndarray
    moment_arm: ndarray
    tilt: ndarray
    azimuth: ndarray
    acceptance: float


def build(sensor: Sensor) -> Specimen:
    """The specimen of a sensor: always the same draws, times its spread."""
    rng = np.random.default_rng([sensor.specimen, *sensor.name.encode()])
    spread = sensor.spread
    normal = np.clip(rng.standard_normal(64), -3.0, 3.0)
    joints = joints_of(sensor)
    turned = sensor.azimuth + 2 * np.pi / OUTPUTS * np.arange(OUTPUTS) + spread * normal[0]
    acceptance = sensor.acceptance * (1 + spread * normal[1])
    more = rng.standard_normal(2 * OUTPUTS + sensor.size + joints)
    tilt, azimuth, gain, moment_arm = np.split(
        np.clip(more, -3.0, 3.0), np.cumsum([OUTPUTS, OUTPUTS, sensor.size])
    )
    return Specimen(
        gain=np.exp(spread * gain) if sensor.kind != "tags" else np.ones(sensor.size),
        moment_arm=1 + spread * moment_arm,
        tilt=TILT * (1 + spread * tilt),
        azimuth=turned + 0.3 * spread * azimuth,
        acceptance=acceptance,
    )


def joints_of(sensor: Sensor) -> int:
    """Number of joints of fibres."""
    return {"planar": sensor.segments - 1, "spatial": 1, "tags": 0}[sensor.kind]


def follow(play: ndarray, bend: ndarray) -> None:
    """Drag what lags behind: play operators (n, j, k, 2) of radii `PLAY` after bends (n, j, 2)."""
    gap = bend[:, :, None] - play
    far = np.sqrt(gap[..., 0] ** 2 + gap[..., 1] ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(far > PLAY, 1 - PLAY / far, np.where(far <= PLAY, 0.0, np.nan))
    play += share[..., None] * gap


def lagged(play: ndarray, bend: ndarray, share: ndarray) -> ndarray:
    """Bends (n, j, 2) of which shares (n, j) lag behind (Prandtl-Ishlinskii)."""
    return bend + share[..., None] * (play.mean(axis=2) - bend)
