"""What is known of a robot before it moves: port, timing, limits, calibration of its servos."""

from dataclasses import dataclass, field
from math import floor
from typing import Annotated, Any

from softrobot_env.hardware.protocol.messages import MOST_TENDONS, Capability, Config
from softrobot_env.hardware.robot_file.keys import (
    Key,
    RobotFileError,
    check_numbers,
    check_text,
    keys,
    millimetres,
    milliseconds,
)
from softrobot_env.hardware.robot_file.parts import Servo, Supervision, Tip
from softrobot_env.robots import LENGTH_SCALE, SERVO_SPEED

#: Baud rates that a 16 MHz microcontroller meets.
BAUDS = (57600, 115200, 250000, 500000, 1000000)

#: [s], longest ramp: from one end of a range to the other. A board cuts the power after it.
LONGEST_RAMP = 10.0

_EXACT = 1e-9  # m

#: UDP port at which a tracker's datagrams arrive unless a robot file says otherwise.
TRACKER_PORT = 47810


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
        state_delay: [s] from a set-point to the measurement that answers it.
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
            watchdog_ms=self._counts("watchdog"),
            state_delay_us=self._counts("state_delay"),
            free_run_ms=self._counts("free_run"),
            ramp=self._counts("ramp"),
            arm_window=self._counts("arm_window"),
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
            slew=(self._counts("slew"),) * len(self.tendons),
            rest=self._each("rest"),
            max_force=self._each("max_force"),
            min_force=self._each("min_force"),
        )

    def _counts(self, name: str) -> int:
        return _counts(self, name)

    def _each(self, name: str) -> tuple[int, ...]:
        """A number of every servo, in the order of the board's channels."""
        servos = sorted(self.tendons, key=lambda servo: servo.channel)
        return tuple(_counts(servo, name) for servo in servos)


def rig_file(port: str = "/dev/ttyUSB0") -> RobotFile:
    """The spatial test rig before its calibration: three tendons of 30 mm either way.

    A servo turns half a turn in 2000 us and winds with a horn of 20 mm. Only the supply is watched,
    as on a board that measures neither lengths nor forces.
    """
    return RobotFile(
        name="rig",
        port=port,
        tendons=tuple(Servo(k, 1500e-6, 31.83e-3, -LENGTH_SCALE, LENGTH_SCALE) for k in range(3)),
        slew=floor(1e5 * SERVO_SPEED) / 1e5,
    )


def _counts(record: Any, name: str) -> int:
    return keys(type(record))[name].counts(getattr(record, name))
