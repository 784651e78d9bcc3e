"""Types of messages, as tables.

Lengths travel in 0.01 mm, forces in 0.01 N, times in microseconds of a clock that wraps at 2**32.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, get_args

PROTOCOL = 1

#: Most tendons a message can hold.
MOST_TENDONS = 6

#: Channels of the analogue-digital converter in a `State`.
ADC_CHANNELS = 4

#: A length [m], a force [N] and a time [s] of one unit on the wire.
LENGTH_UNIT, FORCE_UNIT, CLOCK_UNIT = 1e-5, 1e-2, 1e-6

U8, U16, U32 = Annotated[int, "B"], Annotated[int, "H"], Annotated[int, "I"]
I32 = Annotated[int, "i"]
#: One number for each of the message's `n` tendons.
U16N, I16N = Annotated[tuple[int, ...], "H"], Annotated[tuple[int, ...], "h"]
#: One number for each channel of the converter.
U16ADC = Annotated[tuple[int, ...], "H", ADC_CHANNELS]


@dataclass(frozen=True)
class Hello:
    """Who is there? Ends any session; running outputs ramp down."""

    number: ClassVar[int] = 1
    nonce: U32
    min_protocol: U8
    max_protocol: U8


@dataclass(frozen=True)
class Config:
    """Calibration and limits; accepted while disarmed only.

    A pulse is `center_us + gain * length`; gain is in 0.01 us per mm. Zero in `max_force`,
    `min_force`, `stall_error` and `vbus_min` switches a check off.
    """

    number: ClassVar[int] = 2
    n: U8
    watchdog_ms: U16
    state_delay_us: U16  # from an accepted set-point to the state that echoes it
    free_run_ms: U16  # between states without set-points
    ramp: U16  # 0.01 mm/s, speed of a stop
    arm_window: U16  # 0.01 mm, from the present position to a first set-point
    stall_error: U16  # 0.01 mm between driven and measured length
    stall_ms: U16  # that a stall, a wrong force or a rail must last
    adc_mask: U8  # channels that are supervised
    adc_low: U16
    adc_high: U16
    vbus_min: U16  # mV
    center_us: U16N
    gain: I16N
    minimum: I16N  # 0.01 mm, range of set-points
    maximum: I16N
    slew: U16N  # 0.01 mm/s, largest speed of an output
    rest: I16N  # 0.01 mm, where a stop ends: tendons pretensioned
    max_force: U16N  # 0.01 N
    min_force: U16N


@dataclass(frozen=True)
class Arm:
    """Begin a session; `config_crc` is that of the last `ConfigAck`."""

    number: ClassVar[int] = 3
    session: U16
    config_crc: U32


@dataclass(frozen=True)
class Setpoint:
    """Where outputs shall go; `seq` grows from one to the next. Feeds the watchdog if accepted."""

    number: ClassVar[int] = 4
    session: U16
    t_host: U32
    ttl_ms: U16
    mode: U8
    n: U8
    target: I16N  # 0.01 mm


@dataclass(frozen=True)
class Ping:
    """Asks for a `Pong`; feeds nothing."""

    number: ClassVar[int] = 5
    t_host: U32


@dataclass(frozen=True)
class Stop:
    """Ramp to rest, then off. A ramp of zero is the configured one."""

    number: ClassVar[int] = 6
    session: U16
    ramp: U16


@dataclass(frozen=True)
class EStop:
    """Cut the outputs at once, whatever the session; latches."""

    number: ClassVar[int] = 7


@dataclass(frozen=True)
class Clear:
    """Clear the latched fault, which must be named."""

    number: ClassVar[int] = 8
    fault: U8


@dataclass(frozen=True)
class Disarm:
    """End the session; running outputs ramp down."""

    number: ClassVar[int] = 9
    session: U16


@dataclass(frozen=True)
class HelloAck:
    """Answer to `Hello`. `boot_id` is another one after every start."""

    number: ClassVar[int] = 65
    nonce: U32
    boot_id: U32
    firmware: U16  # major << 8 | minor
    min_protocol: U8
    max_protocol: U8
    schema: U32
    n: U8
    capabilities: U16
    reset_cause: U8


@dataclass(frozen=True)
class ConfigAck:
    """The configuration was accepted; `crc` is that of its fields as received."""

    number: ClassVar[int] = 66
    crc: U32


@dataclass(frozen=True)
class State:
    """What the microcontroller measures and does."""

    number: ClassVar[int] = 67
    t_dev: U32
    last_seq: U16  # of the last accepted set-point
    t_host_echo: U32  # its t_host
    state: U8
    n: U8
    faults: U16
    warnings: U16
    session: U16
    applied: I16N  # 0.01 mm, what the outputs were driven to
    length: I16N  # 0.01 mm, measured; as applied without that capability
    force: I16N  # 0.01 N, measured; zero without that capability
    adc: U16ADC
    vbus: U16  # mV
    crc_errors: U16
    frame_errors: U16


@dataclass(frozen=True)
class Pong:
    """Answer to `Ping`."""

    number: ClassVar[int] = 68
    t_host: U32
    t_dev: U32


@dataclass(frozen=True)
class FaultReport:
    """The first cause of a fault; repeated while it is latched."""

    number: ClassVar[int] = 69
    code: U8
    channel: U8
    value: I32
    t_dev: U32


@dataclass(frozen=True)
class Nack:
    """A message was refused."""

    number: ClassVar[int] = 70
    about: U8  # its type
    about_seq: U16
    reason: U8


Message = (
    Hello | Config | Arm | Setpoint | Ping | Stop | EStop | Clear | Disarm
    | HelloAck | ConfigAck | State | Pong | FaultReport | Nack
)  # fmt: skip

TYPES: dict[int, type] = {kind.number: kind for kind in get_args(Message)}

#: Types whose checksum does not depend on the schema: they tell what the other side speaks.
UNSEEDED = (Hello.number, HelloAck.number)
