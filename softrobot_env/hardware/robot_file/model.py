"""What is known of a robot before it moves: port, timing, limits, calibration of its servos."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import floor
from typing import Annotated, Any

from softrobot_env.hardware.protocol.messages import (
    ADC_CHANNELS,
    MOST_TENDONS,
    Capability,
    Config,
)
from softrobot_env.hardware.robot_file.keys import (
    Key,
    RobotFileError,
    check_numbers,
    check_text,
    check_whole,
    keys,
    millimetres,
    milliseconds,
    newtons,
)
from softrobot_env.robots import LENGTH_SCALE, SERVO_SPEED

#: Baud rates that a 16 MHz microcontroller meets.
BAUDS = (57600, 115200, 250000, 500000, 1000000)

#: [s], longest ramp: from one end of a range to the other. A board cuts the power after it.
LONGEST_RAMP = 10.0

_EXACT = 1e-9  # m

#: Pulses [s] that no servo is driven beyond.
SHORTEST_PULSE, LONGEST_PULSE = 400e-6, 2600e-6

_EXACT_PULSE = 1e-3  # µs

_ADC_TOP = 4095  # counts of twelve bits

#: UDP port at which a tracker's datagrams arrive unless a robot file says otherwise.
TRACKER_PORT = 47810


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
            if not shortest - _EXACT_PULSE <= pulse <= longest + _EXACT_PULSE:
                raise RobotFileError(
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

    name: str
    port: str
    tendons: tuple[Servo, ...]
    baud: int = 500000
    control_period: Annotated[float, Key("control_period_ms", 1e-3, 0.001, 1, 200)] = 0.02
    watchdog: Annotated[float, milliseconds("watchdog_ms", 20, 1000)] = 0.1
    ttl: Annotated[float, milliseconds("ttl_ms", 1, 1000)] = 0.05
    state_delay: Annotated[float, Key("state_delay_ms", 1e-3, 0.001, 0, 65)] = 0.012
    free_run: Annotated[float, milliseconds("free_run_ms", 5, 1000)] = 0.05
    slew: Annotated[float, millimetres("slew_mm_per_s", 0.01, 655.35)] = 0.1
    ramp: Annotated[float, millimetres("ramp_mm_per_s", 0.01, 655.35)] = 0.03
    arm_window: Annotated[float, millimetres("arm_window_mm", 0.01, 100)] = 2e-3
    supervision: Supervision = field(default_factory=Supervision)
    tip: Tip = field(default_factory=lambda: Tip("udp", {"port": TRACKER_PORT}))

    def __post_init__(self) -> None:
        check_numbers(self)
        check_text("name", self.name)
        check_text("port", self.port)
        if isinstance(self.baud, bool) or self.baud not in BAUDS:
            raise RobotFileError(f"baud must be one of {', '.join(map(str, BAUDS))}")
        self._check_timing()
        self._check_ramp()
        channels = [servo.channel for servo in self.tendons]
        if not 1 <= len(channels) <= MOST_TENDONS:
            raise RobotFileError(f"a robot has 1 to {MOST_TENDONS} tendons, got {len(channels)}")
        if sorted(channels) != list(range(len(channels))):
            raise RobotFileError(
                f"the tendons need channels 0 to {len(channels) - 1}, each once, got {channels}"
            )

    def _check_timing(self) -> None:
        if not self.state_delay < self.control_period:
            raise RobotFileError("state_delay_ms must be smaller than control_period_ms")
        if self.watchdog < 2 * self.control_period:
            raise RobotFileError("watchdog_ms must be at least twice control_period_ms")
        if self.ttl > self.watchdog:
            raise RobotFileError("ttl_ms must not be larger than watchdog_ms")

    def _check_ramp(self) -> None:
        longest = max((s.maximum - s.minimum for s in self.tendons), default=0.0)
        if longest > LONGEST_RAMP * min(self.ramp, self.slew) + _EXACT:
            raise RobotFileError(
                f"ramp_mm_per_s and slew_mm_per_s must cross every range within {LONGEST_RAMP:g} "
                f"s: at least {1e3 * longest / LONGEST_RAMP:g} mm/s"
            )

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
    return keys(type(record))[name].counts(getattr(record, name))
