"""What is known of motors on a bus that wind a robot's tendons: the table `[hardware]` of its file.

Safety limits are said here once. The host keeps them (`motors.MotorRobot`), and writes to the
motors those that these have a register for.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil, inf, pi, radians
from typing import Annotated, Any, Literal, NamedTuple, Self

from softrobot_env.core.records import (
    Key,
    Name,
    Range,
    Record,
    Unit,
    check_fields,
    placed,
    read,
    unwritten,
    whole_numbers,
)

from .robot_file import TRACKER_PORT, Tip, read_tip

_MM, _MM_S, _MS, _DEG = (
    Unit("mm", 1e-3),
    Unit("mm_per_s", 1e-3),
    Unit("ms", 1e-3),
    Unit("deg", radians(1)),
)


def _between(least: float, most: float) -> Range:
    return Range(f"in [{least:g}, {most:g}]", lambda x: least <= x <= most)


_Length = Annotated[float, _MM, _between(-1000, 1000)]
_Speed = Annotated[float, _MM_S, _between(0.01, 1000)]
_Current = Annotated[float, Unit("a"), _between(0, 30)]

#: How a motor follows its goal: within a turn, over many turns, or over many with its current
#: limited to `max_current_a` at any time.
Mode = Literal["position", "extended_position", "current_position"]


@dataclass(frozen=True)
class Motor(Record):
    """A motor and its spool: at a pulled-in length it stands at `zero + direction * length / r`.

    Attributes:
        id: Its number on the bus.
        tendon: Name of the tendon; a second motor may wind the same one.
        spool_radius: [m], r, to the middle of the tendon.
        direction: 1 where the angle grows as the tendon is pulled in, else -1.
        zero: Angle [rad] at length zero; `softrobot robot home` finds it.
        minimum, maximum: Range [m] of pulled-in lengths.
        rest: [m], where a stop ends: pretensioned.
        max_current: [A] beyond which the robot stops; 0 switches the check off.
        max_temperature: [°C] beyond which it stops.
        torque_constant: [N m/A], for an estimate of the tension; 0: there is none.
    """

    id: Annotated[int, whole_numbers(0, 252)]
    tendon: Name
    spool_radius: Annotated[float, _MM, _between(0.5, 200)]
    direction: Annotated[int, Range("1 or -1", lambda d: d in (1, -1))] = 1
    zero: Annotated[float, _DEG, _between(-92160, 92160)] = pi
    minimum: _Length = -0.01
    maximum: _Length = 0.01
    rest: _Length = 0.0
    max_current: _Current = 0.0
    max_temperature: Annotated[float, Unit("c"), _between(20, 100)] = 70.0
    torque_constant: Annotated[float, Unit("nm_per_a"), _between(0, 100)] = 0.0

    def __post_init__(self) -> None:
        check_fields(self, f"motor {self.id}")
        if not self.minimum <= self.rest <= self.maximum or self.minimum == self.maximum:
            raise ValueError(
                "minimum_mm <= rest_mm <= maximum_mm must hold, with minimum_mm < maximum_mm"
            )

    def angle(self, length: float) -> float:
        """Angle [rad] at a pulled-in length [m]."""
        return self.zero + self.direction * length / self.spool_radius

    def length(self, angle: float) -> float:
        """Pulled-in length [m] at an angle [rad]."""
        return self.direction * (angle - self.zero) * self.spool_radius


class TendonRange(NamedTuple):
    """Where a tendon may be [m], by all its motors; see `interface.Limits`."""

    minimum: float
    maximum: float
    rest: float


@dataclass(frozen=True)
class MotorFile:
    """Motors on a bus.

    Attributes:
        kind: Out of `registry.HARDWARE`.
        port: Path of the serial port.
        motors: One or two for each tendon.
        name, tendon_names: Of the robot, whose file this is part of.
        baud: Rate of the bus.
        mode: See `Mode`.
        control_period: [s] between set-points.
        watchdog: [s] without a set-point after which the robot is no longer driven: by the host,
            and by motors that have a watchdog.
        slew: Largest speed [m/s] of a tendon.
        ramp: Speed [m/s] of a stop, and of homing.
        arm_window: [m], farthest outside its range that a tendon may be when the robot is armed.
        stall: [m] between driven and measured length that stops the robot; 0 switches it off.
        patience: [s] that a stall, too much current or a motor's silence must last to stop it.
        supply: Lowest voltage [V]; 0 switches the check off.
        at_stop: Whether motors relax or hold at the end of a stop.
        latency: [s] that the converter adds to an answer, such as the latency timer of a U2D2.
        home_current: [A] at which a tendon counts as taut.
        home_travel: [m], most that homing pulls in.
        home_backoff: [m] that it lets out again; there is length zero.
        tip: What measures the tip.
    """

    kind: str
    port: str
    motors: Annotated[tuple[Motor, ...], Key("motor")]
    name: str = unwritten("robot")
    tendon_names: tuple[str, ...] = unwritten(())
    baud: Annotated[int, whole_numbers(9600, 4500000)] = 1000000
    mode: Mode = "extended_position"
    control_period: Annotated[float, _MS, _between(1, 200)] = 0.02
    watchdog: Annotated[float, _MS, _between(20, 2000)] = 0.1
    slew: _Speed = 0.05
    ramp: _Speed = 0.02
    arm_window: Annotated[float, _MM, _between(0.01, 100)] = 2e-3
    stall: Annotated[float, _MM, _between(0, 100)] = 5e-3
    patience: Annotated[float, _MS, _between(0, 2000)] = 0.1
    supply: Annotated[float, Unit("v"), _between(0, 60)] = 0.0
    at_stop: Literal["relax", "hold"] = "relax"
    latency: Annotated[float, _MS, _between(0, 50)] = 4e-3
    home_current: _Current = 0.1
    home_travel: Annotated[float, _MM, _between(0.1, 1000)] = 0.02
    home_backoff: Annotated[float, _MM, _between(0, 100)] = 5e-4
    tip: Tip = field(default_factory=lambda: Tip("udp", {"port": TRACKER_PORT}))

    def __post_init__(self) -> None:
        check_fields(self, "hardware")
        if self.watchdog < 2 * self.control_period:
            raise ValueError("watchdog_ms must be at least twice control_period_ms")
        numbers = [motor.id for motor in self.motors]
        if not numbers or len(set(numbers)) < len(numbers):
            raise ValueError(f"motors need different ids, one or more, got {numbers}")
        if not self.tendon_names:
            names = tuple(dict.fromkeys(motor.tendon for motor in self.motors))
            object.__setattr__(self, "tendon_names", names)
        for motor in self.motors:
            if motor.tendon not in self.tendon_names:
                raise ValueError(
                    f"motor {motor.id} winds tendon {motor.tendon!r}, the robot's are "
                    f"{', '.join(self.tendon_names)}"
                )
            ends = [motor.angle(motor.minimum), motor.angle(motor.maximum)]
            if self.mode == "position" and not 0 <= min(ends) <= max(ends) < 2 * pi:
                raise ValueError(
                    f"motor {motor.id}: its range leads from {ends[0]:.2f} to {ends[1]:.2f} rad; "
                    "mode 'position' has one turn, from 0: move zero_deg, or take "
                    "'extended_position'"
                )
        for name in self.tendon_names:
            self._check_tendon(name)

    def _check_tendon(self, name: str) -> None:
        mine = self.of_tendon(name)
        if not 1 <= len(mine) <= 2:
            raise ValueError(f"tendon {name!r} needs one motor or two, it has {len(mine)}")
        if len({(m.minimum, m.maximum, m.rest) for m in mine}) > 1:
            raise ValueError(f"the two motors of tendon {name!r} need one range and one rest")

    def of_tendon(self, name: str) -> list[Motor]:
        """The motors that wind a tendon."""
        return [motor for motor in self.motors if motor.tendon == name]

    @cached_property
    def tendons(self) -> tuple[TendonRange, ...]:
        """Ranges of the robot's tendons, in their order."""
        first = (self.of_tendon(name)[0] for name in self.tendon_names)
        return tuple(TendonRange(m.minimum, m.maximum, m.rest) for m in first)

    @property
    def state_delay(self) -> float:
        """See `interface.HardwareFile`: motors answer at once."""
        return 0.0

    def jogged(self) -> Self:
        """See `interface.HardwareFile`: by `home_travel` wider, within the turn of `position`."""
        return replace(
            self,
            motors=tuple(self._widened(motor) for motor in self.motors),
            slew=min(self.slew, self.ramp),
            watchdog=max(self.watchdog, 0.5),
            arm_window=self.home_travel,
        )

    def _widened(self, motor: Motor) -> Motor:
        low, high = motor.minimum - self.home_travel, motor.maximum + self.home_travel
        if self.mode == "position":
            ends = sorted((motor.length(0.0), motor.length(2 * pi * (1 - 1e-6))))
            low, high = max(low, ends[0]), min(high, ends[1])
        return replace(motor, minimum=low, maximum=high)

    def calibrated(self, marks: Sequence[Sequence[float]]) -> Self:
        """See `interface.HardwareFile`."""
        found = dict(zip(self.tendon_names, marks, strict=True))
        return replace(self, motors=tuple(_marked(m, *found[m.tendon]) for m in self.motors))


def _marked(motor: Motor, zero: float, minimum: float, maximum: float, rest: float) -> Motor:
    return replace(
        motor,
        zero=motor.angle(zero),
        minimum=minimum - zero,
        maximum=maximum - zero,
        rest=rest - zero,
    )


def read_motors(table: Mapping[str, Any], name: str, tendon_names: Sequence[str]) -> MotorFile:
    """Motors as a table `[hardware]` says, of a robot and its tendons.

    Raises:
        ValueError: It says what is not allowed; names the key.
    """
    file = read(MotorFile, {"motor": []} | dict(table), "hardware", {"tip": read_tip})
    with placed("hardware", MotorFile):
        return replace(file, name=name, tendon_names=tuple(tendon_names))


def usual_motors(
    kind: str, port: str, tendon_names: Sequence[str], travel: Sequence[float], speed: float
) -> MotorFile:
    """Motors of a robot whose file says none: ids from 1, spools of 10 mm, 3 A, its actions' range.

    Args:
        kind, port: See `MotorFile`.
        tendon_names: The robot's tendons.
        travel: (n,) [m], pulled in by full actions.
        speed: [m/s] of its drive, or inf.
    """
    motors = tuple(
        Motor(k, name, 0.01, 1, pi, -ceil(1e3 * x) / 1e3, ceil(1e3 * x) / 1e3, max_current=3.0)
        for k, (name, x) in enumerate(zip(tendon_names, travel, strict=True), 1)
    )
    slew = MotorFile.slew if speed == inf else speed
    return MotorFile(kind, port, motors, slew=slew, tendon_names=tuple(tendon_names))
