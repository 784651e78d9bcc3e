"""Robot files: what is known of a real robot before it moves, as TOML with units in its keys.

Port, timing, limits, calibration of its servos. Numbers are kept in SI; one that is finer than
what a message can carry is refused, not rounded.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import ceil, floor, isfinite, nan
from pathlib import Path
from typing import Annotated, Any, Self, get_type_hints

import numpy as np

from softrobot_env.core.files import read_table, text, write_text
from softrobot_env.core.records import (
    Name,
    Range,
    Record,
    Unit,
    check_fields,
    placed,
    read,
    whole_numbers,
    write,
)
from softrobot_env.core.registry import is_path
from softrobot_env.robots import LENGTH_SCALE, SERVO_SPEED

from .interface import HardwareFile
from .protocol.messages import ADC_CHANNELS, MOST_TENDONS, Capability, Config

#: Baud rates that a 16 MHz microcontroller meets.
BAUDS = (57600, 115200, 250000, 500000, 1000000)

#: [s], longest ramp: from one end of a range to the other. A board cuts the power after it.
LONGEST_RAMP = 10.0

_EXACT = 1e-9  # m

#: Pulses [s] that no servo is driven beyond.
SHORTEST_PULSE, LONGEST_PULSE = 400e-6, 2600e-6

_EXACT_PULSE = 1e-3  # µs

_ADC_TOP = 4095  # counts of twelve bits
_AdcCount = Annotated[int, whole_numbers(0, _ADC_TOP)]

#: UDP port at which a tracker's datagrams arrive unless a robot file says otherwise.
TRACKER_PORT = 47810


@dataclass(frozen=True)
class Steps(Range):
    """Range of a number that a message carries in steps.

    Attributes:
        size: Of a step, in the unit of the file.
    """

    size: float


def _steps(size: float, least: float, most: float) -> Steps:
    def holds(number: float) -> bool:
        inside = least <= number <= most
        return inside and abs(number / size - round(number / size)) <= _EXACT_STEP

    return Steps(f"in [{least:g}, {most:g}] in steps of {size:g}", holds, size)


_EXACT_STEP = 1e-6  # of a step; what is left of a decimal number after a change of units
_MM, _MM_S, _MS = Unit("mm", 1e-3), Unit("mm_per_s", 1e-3), Unit("ms", 1e-3)
_Length = Annotated[float, _MM, _steps(0.01, -300, 300)]
_Speed = Annotated[float, _MM_S, _steps(0.01, 0.01, 655.35)]
_Force = Annotated[float, Unit("n"), _steps(0.01, 0, 600)]


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

    channel: Annotated[int, whole_numbers(0, MOST_TENDONS - 1)]
    center: Annotated[float, Unit("us", 1e-6), _steps(1, 400, 2600)]
    gain: Annotated[float, Unit("us_per_mm", 1e-3), _steps(0.01, -300, 300)]
    minimum: _Length
    maximum: _Length
    rest: _Length = 0.0
    max_force: _Force = 0.0
    min_force: _Force = 0.0

    def __post_init__(self) -> None:
        check_fields(self, "servo")
        if self.gain == 0:
            raise ValueError("gain_us_per_mm must not be zero")
        if not self.minimum <= self.rest <= self.maximum or self.minimum == self.maximum:
            raise ValueError(
                "minimum_mm <= rest_mm <= maximum_mm must hold, with minimum_mm < maximum_mm"
            )
        shortest, longest = 1e6 * SHORTEST_PULSE, 1e6 * LONGEST_PULSE
        for name in ("minimum", "maximum"):
            pulse = 1e6 * self.pulse(getattr(self, name))
            if not shortest - _EXACT_PULSE <= pulse <= longest + _EXACT_PULSE:
                raise ValueError(
                    f"{name}_mm means a pulse of {pulse:.0f} µs, allowed are {shortest:.0f} to "
                    f"{longest:.0f} µs"
                )

    def pulse(self, length: float) -> float:
        """Pulse [s] at a pulled-in length [m]."""
        return self.center + self.gain * length

    def length(self, pulse: float) -> float:
        """Pulled-in length [m] at a pulse [s]."""
        return (pulse - self.center) / self.gain


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

    stall: Annotated[float, _MM, _steps(0.01, 0, 100)] = 0.0
    time: Annotated[float, _MS, _steps(1, 10, 10000)] = 0.3
    adc_channels: tuple[Annotated[int, whole_numbers(0, ADC_CHANNELS - 1)], ...] = ()
    adc_low: _AdcCount = 8
    adc_high: _AdcCount = _ADC_TOP - 8
    supply: Annotated[float, Unit("v"), _steps(0.001, 0, 60)] = 4.8

    def __post_init__(self) -> None:
        check_fields(self, "supervision")
        if not self.adc_low < self.adc_high:
            raise ValueError("adc_low must be smaller than adc_high")


@dataclass(frozen=True)
class Tip(Record):
    """What measures the tip: the name of a kind of source, and its options."""

    kind: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class RobotFile:
    """A robot, as a file describes it.

    Attributes:
        name: For people.
        port: Path of the serial port.
        baud: Out of `BAUDS`.
        tendons: A servo for each.
        control_period: [s] between set-points.
        watchdog: [s] without a set-point after which the robot stops by itself.
        ttl: [s] after which a set-point is too old to be followed.
        state_delay: [s] from a set-point to the measurement that answers it, at most: one that
            `free_run` makes due before answers it too.
        free_run: [s] between measurements without set-points.
        slew: Largest speed [m/s] of an output.
        ramp: Speed [m/s] of a stop.
        arm_window: [m], farthest that a first set-point may lie from the present position.
        supervision: What else stops the robot.
        tip: What measures the tip.
    """

    name: Name
    port: str
    tendons: tuple[Servo, ...]
    baud: Annotated[int, Range(f"one of {', '.join(map(str, BAUDS))}", BAUDS.__contains__)] = 500000
    control_period: Annotated[float, _MS, _steps(0.001, 1, 200)] = 0.02
    watchdog: Annotated[float, _MS, _steps(1, 20, 1000)] = 0.1
    ttl: Annotated[float, _MS, _steps(1, 1, 1000)] = 0.05
    state_delay: Annotated[float, _MS, _steps(0.001, 0, 65)] = 0.012
    free_run: Annotated[float, _MS, _steps(1, 5, 1000)] = 0.05
    slew: _Speed = 0.1
    ramp: _Speed = 0.03
    arm_window: Annotated[float, _MM, _steps(0.01, 0.01, 100)] = 2e-3
    supervision: Supervision = field(default_factory=Supervision)
    tip: Tip = field(default_factory=lambda: Tip("udp", {"port": TRACKER_PORT}))

    def __post_init__(self) -> None:
        check_fields(self, "robot file")
        if not self.state_delay < self.control_period:
            raise ValueError("state_delay_ms must be smaller than control_period_ms")
        if self.watchdog < 2 * self.control_period:
            raise ValueError("watchdog_ms must be at least twice control_period_ms")
        if self.ttl > self.watchdog:
            raise ValueError("ttl_ms must not be larger than watchdog_ms")
        longest = max((s.maximum - s.minimum for s in self.tendons), default=0.0)
        if longest > LONGEST_RAMP * min(self.ramp, self.slew) + _EXACT:
            raise ValueError(
                f"ramp_mm_per_s and slew_mm_per_s must cross every range within {LONGEST_RAMP:g} "
                f"s: at least {1e3 * longest / LONGEST_RAMP:g} mm/s"
            )
        channels = [servo.channel for servo in self.tendons]
        if not 1 <= len(channels) <= MOST_TENDONS:
            raise ValueError(f"a robot has 1 to {MOST_TENDONS} tendons, got {len(channels)}")
        if sorted(channels) != list(range(len(channels))):
            raise ValueError(
                f"the tendons need channels 0 to {len(channels) - 1}, each once, got {channels}"
            )

    def jogged(self) -> Self:
        """The robot with ranges as wide as its servos' pulses, as slow as its ramp, and patient.

        Where the way from end to end would take more than the longest ramp, they are narrower.
        """
        return replace(
            self,
            tendons=tuple(_widest(servo, self) for servo in self.tendons),
            slew=min(self.slew, self.ramp),
            watchdog=max(self.watchdog, _WATCHDOG),
        )

    def calibrated(self, marks: tuple[tuple[float, float, float, float], ...]) -> Self:
        """The robot with marks (n, 4) [m] of its tendons: zero, minimum, maximum, rest.

        Raises:
            ValueError: They contradict each other, for instance a rest out of range.
        """
        pairs = zip(self.tendons, marks, strict=True)
        return replace(self, tendons=tuple(_calibrated(*pair) for pair in pairs))

    def needs(self) -> dict[Capability, str]:
        """What a board must measure, and the key that asks for it."""
        forces = any(servo.max_force or servo.min_force for servo in self.tendons)
        asked = {
            Capability.LENGTH: ("stall_mm", self.supervision.stall),
            Capability.FORCE: ("max_force_n, min_force_n", forces),
            Capability.ADC: ("adc_channels", self.supervision.adc_channels),
            Capability.SUPPLY: ("supply_v", self.supervision.supply),
        }
        return {what: key for what, (key, value) in asked.items() if value}

    def to_message(self) -> Config:
        """The configuration as it goes to the microcontroller."""
        watched = self.supervision
        return Config(
            n=len(self.tendons),
            watchdog_ms=_counts(self, "watchdog"),
            state_delay_us=_counts(self, "state_delay"),
            free_run_ms=_counts(self, "free_run"),
            ramp=_counts(self, "ramp"),
            arm_window=_counts(self, "arm_window"),
            stall_error=_counts(watched, "stall"),
            stall_ms=_counts(watched, "time"),
            adc_mask=sum(1 << channel for channel in set(watched.adc_channels)),
            adc_low=watched.adc_low,
            adc_high=watched.adc_high,
            vbus_min=_counts(watched, "supply"),
            center_us=self._each("center"),
            gain=self._each("gain"),
            minimum=self._each("minimum"),
            maximum=self._each("maximum"),
            slew=(_counts(self, "slew"),) * len(self.tendons),
            rest=self._each("rest"),
            max_force=self._each("max_force"),
            min_force=self._each("min_force"),
        )

    def _each(self, name: str) -> tuple[int, ...]:
        """A number of every servo, in the order of the board's channels."""
        servos = sorted(self.tendons, key=lambda servo: servo.channel)
        return tuple(_counts(servo, name) for servo in servos)


def rig_file(port: str = "/dev/ttyUSB0") -> RobotFile:
    """The spatial test rig before its calibration: three tendons of 30 mm either way.

    A servo turns half a turn in 2000 µs and winds with a horn of 20 mm. Only the supply is watched,
    as on a board that measures neither lengths nor forces.
    """
    return RobotFile(
        name="rig",
        port=port,
        tendons=tuple(Servo(k, 1500e-6, 31.83e-3, -LENGTH_SCALE, LENGTH_SCALE) for k in range(3)),
        slew=floor(1e5 * SERVO_SPEED) / 1e5,
    )


def virtual_file(port: str = "/dev/ttyUSB0") -> RobotFile:
    """Robot file of a virtual robot: the rig's, with the checks of what only this one measures."""
    file = rig_file(port)
    servos = tuple(replace(servo, max_force=40.0) for servo in file.tendons)
    return replace(file, tendons=servos, supervision=replace(file.supervision, stall=5e-3))


def _counts(record: Any, name: str) -> int:
    """A field as the number of steps that a message carries."""
    unit, steps = get_type_hints(type(record), include_extras=True)[name].__metadata__
    return round(getattr(record, name) / unit.si / steps.size)


def read_robot_file(path: Path) -> RobotFile:
    """Robot that a TOML file describes.

    Raises:
        ValueError: The file is no TOML or says what is not allowed; names file and key.
        OSError: The file cannot be read.
    """
    with placed(path):
        return robot_from_table(tip_from(read_table(path), path.parent))


def robot_from_table(table: Mapping[str, Any]) -> RobotFile:
    """Robot that a table describes; errors as of `read_robot_file`."""
    return read(RobotFile, {"tendons": []} | dict(table), readers={"tip": read_tip})


def write_robot_file(robot: RobotFile, path: Path) -> None:
    """Write a robot to a TOML file that `read_robot_file` reads as the same robot."""
    table = write(robot, full=True)
    write_text(path, text(table | {"tip": {"kind": robot.tip.kind, **robot.tip.options}}))


def tip_from(table: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """A table whose `tip` names files of a folder, such as `camera`, by paths that hold anywhere.

    A text is a file's name if it has a suffix and there is such a file; `file.py:Name` too.
    """
    tip = table.get("tip")
    if not isinstance(tip, Mapping):
        return dict(table)
    return {**table, "tip": {key: _from_folder(value, folder) for key, value in tip.items()}}


def _from_folder(value: Any, folder: Path) -> Any:
    if not isinstance(value, str):
        return value
    name, colon, rest = value.rpartition(":") if is_path(value) else (value, "", "")
    there = (folder / name).resolve()
    return f"{there}{colon}{rest}" if there.suffix and there.is_file() else value


def read_tip(table: Any, where: str) -> Tip:
    """What measures the tip; all keys but its kind are options."""
    if not isinstance(table, Mapping):
        raise ValueError(f"{where} must be a table, got {table!r}")
    with placed(where):
        for key, value in table.items():
            if not _is_finite(value):
                raise ValueError(f"{key} must be finite, got {value!r}")
        return Tip(table.get("kind"), {k: v for k, v in table.items() if k != "kind"})


def _is_finite(value: Any) -> bool:
    """Whether all numbers within a value of TOML are finite."""
    if isinstance(value, Mapping):
        return all(map(_is_finite, value.values()))
    if isinstance(value, list):
        return all(map(_is_finite, value))
    return not isinstance(value, float) or isfinite(value)


# ---------------------------------------------------------------- calibration by jogging
_STEP, _DIGITS = 1e-5, 5  # m, of lengths in a robot file
_LARGEST = 0.3  # m
_WHOLE = 1e-6  # steps
_WATCHDOG = 0.5  # s, so that output to a slow terminal is no reason to stop
_MARKS = ("zero", "min", "max", "rest")

#: What `Calibration.obey` understands.
HELP = """\
t 2         choose tendon 2
+1.5, -0.2  pull the tendon in, or let it out, by so many mm
zero        this is length zero
min, max    this is an end of the range
rest        here a stop ends: pretensioned"""


class UnknownCommandError(ValueError):
    """A line that is no command."""


@dataclass(frozen=True)
class Calibration:
    """What has been found so far; lengths are those of the robot file that it began with.

    Attributes:
        robot: The robot as it was.
        target: (n,) [m], where the servos are to go.
        tendon: Index of the tendon that is jogged.
        marks: (n, 4) [m]: zero, minimum, maximum, rest.
        keeps_zero: Whether the board measures lengths, and so has a zero of its own.
    """

    robot: HardwareFile
    target: tuple[float, ...]
    tendon: int
    marks: tuple[tuple[float, float, float, float], ...]
    keeps_zero: bool = False

    @classmethod
    def begin(cls, robot: HardwareFile, present: np.ndarray, keeps_zero: bool = False) -> Self:
        """Nothing found, at the present lengths (n,) [m]."""
        marks = tuple((0.0, s.minimum, s.maximum, s.rest) for s in robot.tendons)
        return cls(robot, tuple(np.asarray(present).tolist()), 0, marks, keeps_zero)

    def obey(self, line: str) -> Self:
        """The calibration after a command, see `HELP`.

        Raises:
            UnknownCommandError: No such command.
            ValueError: No such tendon, a way that leads beyond the servo's pulses, or another zero
                than that of a board that measures lengths.
        """
        word, _, rest = line.strip().partition(" ")
        if word == "t":
            return self._choose(rest)
        if word in _MARKS:
            return self._mark(word)
        if word[:1] in ("+", "-"):
            return self._jog(word)
        raise UnknownCommandError(f"unknown command {line.strip()!r}")

    def result(self) -> HardwareFile:
        """The robot as found.

        Raises:
            ValueError: What was found contradicts itself, for instance a rest out of range.
        """
        return self.robot.calibrated(self.marks)

    def _choose(self, text: str) -> Self:
        count = len(self.target)
        if text not in [str(k + 1) for k in range(count)]:
            raise ValueError(f"the tendons are 1 to {count}, got {text!r}")
        return replace(self, tendon=int(text) - 1)

    def _mark(self, name: str) -> Self:
        if name == "zero" and self.keeps_zero:
            raise ValueError(
                "this board measures lengths from its own zero: set it there, see the firmware's "
                "README; the other marks can be set here"
            )
        marks = list(self.marks[self.tendon])
        marks[_MARKS.index(name)] = self.target[self.tendon]
        return replace(self, marks=_with(self.marks, self.tendon, tuple(marks)))

    def _jog(self, text: str) -> Self:
        try:
            way = 1e-3 * float(text)
        except ValueError:
            way = nan
        if not isfinite(way):
            raise ValueError(f"{text!r} is no way in mm")
        servo = self.robot.jogged().tendons[self.tendon]
        length = self.target[self.tendon] + way
        if not servo.minimum <= length <= servo.maximum:
            raise ValueError(
                f"the servo reaches {1e3 * servo.minimum:.2f} to {1e3 * servo.maximum:.2f} mm"
            )
        return replace(self, target=_with(self.target, self.tendon, length))


def _widest(servo: Servo, robot: RobotFile) -> Servo:
    low, high = sorted(servo.length(pulse) for pulse in (SHORTEST_PULSE, LONGEST_PULSE))
    reach = LONGEST_RAMP * min(robot.ramp, robot.slew)
    room = (reach - (servo.maximum - servo.minimum)) / 2
    low = max(low, servo.minimum - room, -_LARGEST)
    high = min(high, servo.maximum + room, _LARGEST)
    # Inwards to whole steps, so that rounding leads to no longer pulse.
    low, high = ceil(low / _STEP - _WHOLE), floor(high / _STEP + _WHOLE)
    return replace(servo, minimum=round(low * _STEP, _DIGITS), maximum=round(high * _STEP, _DIGITS))


def _calibrated(servo: Servo, marks: tuple[float, float, float, float]) -> Servo:
    zero, minimum, maximum, rest = marks
    center = round(1e6 * servo.pulse(zero)) / 1e6
    # What zero really is, now that its pulse is whole microseconds.
    zero = servo.length(center)
    found = {"minimum": minimum - zero, "maximum": maximum - zero, "rest": rest - zero}
    return replace(servo, center=center, **{name: round(x, _DIGITS) for name, x in found.items()})


def _with(values: tuple, index: int, value: object) -> tuple:
    return (*values[:index], value, *values[index + 1 :])
