"""How sensors as built differ from the ideal ones, and how they change: gains, play, drift."""

from typing import NamedTuple

import numpy as np

from softrobot_env.robots.sensors import OUTPUTS, Sensor
from softrobot_env.sensing.optics import TILT

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

    gain: np.ndarray
    moment_arm: np.ndarray
    tilt: np.ndarray
    azimuth: np.ndarray
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


def follow(play: np.ndarray, bend: np.ndarray) -> None:
    """Drag what lags behind: play operators (n, j, k, 2) of radii `PLAY` after bends (n, j, 2)."""
    gap = bend[:, :, None] - play
    far = np.sqrt(gap[..., 0] ** 2 + gap[..., 1] ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(far > PLAY, 1 - PLAY / far, np.where(far <= PLAY, 0.0, np.nan))
    play += share[..., None] * gap


def lagged(play: np.ndarray, bend: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Bends (n, j, 2) of which shares (n, j) lag behind (Prandtl-Ishlinskii)."""
    return bend + share[..., None] * (play.mean(axis=2) - bend)
