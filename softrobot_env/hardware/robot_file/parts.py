"""Parts of a robot file: a servo's calibration, supervision, the source of the tip."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from softrobot_env.hardware.protocol.messages import ADC_CHANNELS, MOST_TENDONS
from softrobot_env.hardware.robot_file.keys import (
    Key,
    RobotFileError,
    check_numbers,
    check_text,
    check_whole,
    millimetres,
    milliseconds,
    newtons,
)

#: Pulses [s] that no servo is driven beyond.
SHORTEST_PULSE, LONGEST_PULSE = 400e-6, 2600e-6

_EXACT = 1e-3  # us

_ADC_TOP = 4095  # counts of twelve bits


@dataclass(frozen=True)
class Servo:
    """Calibration of one tendon's servo: its pulse lasts `center + gain * length`.

    Attributes:
        channel: Output of the board, from 0.
        center: Pulse [s] at length zero.
        gain: [s/m]; negative where a longer pulse lets the tendon out.
        minimum, maximum: Range [m] of pulled-in lengths.
        rest: [m], where a stop ends: pretensioned.
        max_force: [N] beyond which the robot stops; 0 switches the check off.
        min_force: [N] under which the tendon counts as loose; 0 switches the check off.
    """

    channel: int
    center: Annotated[float, Key("center_us", 1e-6, 1.0, 400, 2600)]
    gain: Annotated[float, Key("gain_us_per_mm", 1e-3, 0.01, -300, 300)]
    minimum: Annotated[float, millimetres("minimum_mm", -300, 300)]
    maximum: Annotated[float, millimetres("maximum_mm", -300, 300)]
    rest: Annotated[float, millimetres("rest_mm", -300, 300)] = 0.0
    max_force: Annotated[float, newtons("max_force_n")] = 0.0
    min_force: Annotated[float, newtons("min_force_n")] = 0.0

    def __post_init__(self) -> None:
        check_numbers(self)
        check_whole("channel", self.channel, MOST_TENDONS - 1)
        if self.gain == 0:
            raise RobotFileError("gain_us_per_mm must not be zero")
        if not self.minimum <= self.rest <= self.maximum or self.minimum == self.maximum:
            raise RobotFileError(
                "minimum_mm <= rest_mm <= maximum_mm must hold, with minimum_mm < maximum_mm"
            )
        shortest, longest = 1e6 * SHORTEST_PULSE, 1e6 * LONGEST_PULSE
        for name in ("minimum", "maximum"):
            pulse = 1e6 * self.pulse(getattr(self, name))
            if not shortest - _EXACT <= pulse <= longest + _EXACT:
                raise RobotFileError(
                    f"{name}_mm means a pulse of {pulse:.0f} us, allowed are {shortest:.0f} to "
                    f"{longest:.0f} us"
                )

    def pulse(self, length: float) -> float:
        """Pulse [s] at a pulled-in length [m]."""
        return self.center + self.gain * length


@dataclass(frozen=True)
class Supervision:
    """What the microcontroller watches; zero or an empty tuple switches a check off.

    Attributes:
        stall: [m] between driven and measured length.
        time: [s] that a stall, a wrong force or a rail must last.
        adc_channels: Channels of the converter that must stay off its rails.
        adc_low, adc_high: Counts that lie beyond the rails' ends.
        supply: Lowest voltage [V].
    """

    stall: Annotated[float, millimetres("stall_mm", 0, 100)] = 0.0
    time: Annotated[float, milliseconds("time_ms", 10, 10000)] = 0.3
    adc_channels: tuple[int, ...] = ()
    adc_low: int = 8
    adc_high: int = _ADC_TOP - 8
    supply: Annotated[float, Key("supply_v", 1.0, 0.001, 0, 60)] = 4.8

    def __post_init__(self) -> None:
        check_numbers(self)
        for name in ("adc_low", "adc_high"):
            check_whole(name, getattr(self, name), _ADC_TOP)
        if not self.adc_low < self.adc_high:
            raise RobotFileError("adc_low must be smaller than adc_high")
        for channel in self.adc_channels:
            check_whole("each of adc_channels", channel, ADC_CHANNELS - 1)


@dataclass(frozen=True)
class Tip:
    """What measures the tip: the name of a kind of source, and its options."""

    kind: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_text("kind", self.kind)
        if not isinstance(self.options, Mapping):
            raise RobotFileError(f"options must be a table, got {self.options!r}")
