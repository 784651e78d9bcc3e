"""Sensors that a robot carries, as data; what they read is in `softrobot_env.sensing`.

"T" marks a value printed in the thesis, "I" one inferred from it, "S" an assumption.
"""

from dataclasses import dataclass, replace
from math import radians
from typing import Annotated, Literal
from warnings import warn

from softrobot_env.core.records import Name, Unit, check_fields

from .ranges import (
    Acceptance,
    Angle,
    Delay,
    Length,
    Noise,
    PartOfLight,
    PerForce,
    PerStrain,
    Place,
    Rate,
    Segments,
    Specimen,
    Spread,
    Station,
    Warming,
)

SensorKind = Literal["planar", "spatial", "tags"]

#: Outgoing fibres of a spatial sensor (T).
OUTPUTS = 4

#: [rad], of the fibres (T).
ACCEPTANCE = radians(20)

#: Standard deviations of readings: [LSB] of fibres (T), [rad] of tags (S).
_NOISE = {"planar": 1.4, "spatial": 1.4, "tags": 5e-3}


@dataclass(frozen=True)
class Sensor:
    """A curvature sensor on the backbone.

    * "planar": fibre segments in series; light is lost at each joint by its angle (thesis 4.1).
      One reading, which does not depend on the direction.
    * "spatial": one incoming and four tilted outgoing fibres that meet at the middle (4.2).
      Four readings.
    * "tags": markers seen by a camera: the rotation from each to the next towards an azimuth.

    Readings of fibres are light relative to that of the ideal straight sensor, those of tags are in
    rad. Parameters after `delay` are imperfections; without them a sensor is ideal except for the
    noise and resolution of its converter. They belong to an individual robot: give them to the
    simulated one.

    Attributes:
        name: Of the sensor.
        kind: See above.
        begin, end: [m], arc lengths between which it lies.
        segments: Fibre segments in series, or intervals between tags (T: 3 and 2 per finger piece).
        offset: (2,) [m] in the section, from the neutral fibre.
        azimuth: [rad] of the first outgoing fibre, or of the direction that tags measure.
        acceptance: [rad], angle of the fibres (T: 20 degrees).
        noise: Standard deviation, [LSB] of the converter, or [rad] of tags; see `deviation`.
        rate: [Hz] (T: 50); a sample is taken at the first control instant after it is due.
        delay: [s], rounded to whole control periods.
        temperature: [K], warm-up of the diode after the start (S).
        drift: [1], standard deviation of the slow change of each light path's gain (S).
        hysteresis: [1], fraction of the bend that lags with backlash (I from the thesis' error of
            0.34 degrees with polynomials of order 5).
        stretch: [1], light lost per strain, where the sensor is off the neutral fibre (S).
        stray: [1/N], light that leaks in per contact force on it, relative to straight (S).
        flicker: [1], standard deviation of each sample's gain (audit: 1 to 2 %, S).
        spread: [1], how specimens differ: gains, angles, tilts, acceptance and azimuth [rad] (S).
        specimen: Seed of the specimen's differences.
    """

    name: Name
    kind: SensorKind
    begin: Station
    end: Length
    segments: Segments = 3
    offset: Annotated[tuple[Place, Place], Unit("m")] = (0.0, 0.0)
    azimuth: Angle = 0.0
    acceptance: Acceptance = ACCEPTANCE
    noise: Noise | None = None
    rate: Rate = 50.0
    delay: Delay = 0.0
    temperature: Warming = 0.0
    drift: PartOfLight = 0.0
    hysteresis: PartOfLight = 0.0
    stretch: PerStrain = 0.0
    stray: PerForce = 0.0
    flicker: PartOfLight = 0.0
    spread: Spread = 0.0
    specimen: Specimen = 0

    def __post_init__(self) -> None:
        check_fields(self, "sensor")
        if not self.begin < self.end:
            raise ValueError(
                f"sensor {self.name!r}: begin must be below end, got {self.begin} and {self.end} m"
            )
        if self.kind == "planar" and self.segments < 2:
            raise ValueError(f"sensor {self.name!r}: light is lost between 2 segments or more")

    @property
    def size(self) -> int:
        """Number of readings."""
        return {"planar": 1, "spatial": OUTPUTS, "tags": self.segments}[self.kind]

    @property
    def deviation(self) -> float:
        """Standard deviation of a reading, its kind's own unless given."""
        return _NOISE[self.kind] if self.noise is None else self.noise

    def with_imperfections(self, scale: float, specimen: int) -> "Sensor":
        """A specimen with `scale` times the usual imperfections, besides its own noise.

        Raises:
            ValueError: An imperfection would be out of its range: the scale is beyond 6 or so.
        """
        if scale == 0:
            return self
        usual = {name: scale * value for name, value in USUAL.items()}
        return replace(self, **usual, specimen=specimen)

    def erring(self, scale: float, specimen: int) -> "Sensor":
        """Old name of `with_imperfections`."""
        warn("Sensor.erring is with_imperfections now", DeprecationWarning, stacklevel=2)
        return self.with_imperfections(scale, specimen)


#: Imperfections of usual size; see `Sensor` for where they come from.
USUAL = {
    "temperature": 5.0,
    "drift": 0.01,
    "hysteresis": 0.12,
    "stretch": 1.0,
    "stray": 0.002,
    "flicker": 0.002,
    "spread": 0.05,
}
