"""Messages between host and microcontroller, as tables.

A body is `protocol u8 | type u8 | seq u16 | fields`, little-endian and without gaps. Lengths
travel in 0.01 mm, forces in 0.01 N, times in microseconds of a clock that wraps at 2**32. The
same table in C++ is `firmware/core/schema.h`, which `hardware.schema` writes; `SCHEMA`, a hash of
this one, seeds the checksum of all messages but the first two, so that programs with different
tables do not mistake each other's numbers.
"""

import struct
from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag
from functools import cache
from typing import Annotated, ClassVar, get_args, get_origin, get_type_hints
from zlib import crc32

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

_HEADER = struct.Struct("<BBH")


class DeviceState(IntEnum):
    """What the microcontroller is doing."""

    DISARMED = 0  # outputs off
    ARMED = 1  # outputs off, waiting for a first set-point near the present position
    RUNNING = 2  # outputs follow set-points
    RAMPING = 3  # outputs go to the rest position with a limited speed, and then off
    LATCHED = 4  # outputs off; a fault waits to be cleared


class Fault(IntEnum):
    """Why a microcontroller stopped by itself; `State.faults` has bit 1 << fault."""

    NONE = 0
    WATCHDOG = 1  # no fresh set-point in time
    ESTOP = 2  # emergency stop, by message or by a switch
    FORCE = 3  # a tendon pulls more than allowed
    SLACK = 4  # a tendon is loose
    STALL = 5  # a servo is not where it was driven
    ADC = 6  # a converter's channel is at a rail
    BROWN_OUT = 7  # supply voltage too low


class Warning(IntFlag):
    """Bits of `State.warnings`."""

    SLEWING = 1  # outputs are still on their way to the set-point
    ADC_RAIL = 2  # a supervised channel of the converter is at a rail
    LATE_SETPOINT = 4  # a set-point was older than its time to live
    OLD_SEQUENCE = 8  # a set-point came twice or out of order


class Reset(IntEnum):
    """Why the microcontroller started."""

    POWER_ON = 0
    EXTERNAL = 1
    BROWN_OUT = 2
    WATCHDOG = 3


class Capability(IntFlag):
    """What a board has beyond outputs."""

    LENGTH = 1  # measures the position of its servos
    FORCE = 2  # measures tendon forces
    ADC = 4
    SUPPLY = 8  # measures its supply voltage
    ESTOP_SWITCH = 16


class Reason(IntEnum):
    """Why a message was refused."""

    STATE = 1  # not in this state
    SESSION = 2
    CONFIG = 3  # not configured, or with another configuration
    COUNT = 4  # number of tendons
    RANGE = 5  # a value outside the configured range
    FAR = 6  # first set-point too far from the present position
    FAULT = 7  # clears another fault than the latched one, or its cause is still there
    PROTOCOL = 8
    LATE = 9  # older than its time to live
    SEQUENCE = 10  # not newer than the last one
    MODE = 11


#: Set-points are lengths pulled in. The only mode of protocol 1.
MODE_LENGTH = 0


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


class MessageError(ValueError):
    """Bytes that are no message, or values that do not fit into one."""


def _layout(kind: type) -> list[tuple[str, str, int | str]]:
    """(name, struct code, count) of a type's fields; count "n" is one for each tendon."""
    hints = get_type_hints(kind, include_extras=True)
    found = []
    for field in fields(kind):
        hint = hints[field.name]
        base, code, *count = get_args(hint)
        is_array = get_origin(base) is tuple
        found.append((field.name, code, (count[0] if count else "n") if is_array else 1))
    return found


_LAYOUTS = {number: _layout(kind) for number, kind in TYPES.items()}


def schema_text() -> str:
    """The table as text, one message a line; what `SCHEMA` is the hash of."""
    lines = [f"protocol {PROTOCOL}"]
    for number, kind in TYPES.items():
        parts = (f"{name}:{code}{count}" for name, code, count in _LAYOUTS[number])
        lines.append(" ".join([str(number), kind.__name__, *parts]))
    return "\n".join(lines)


SCHEMA = crc32(schema_text().encode())


def seed(number: int) -> int:
    """What the checksum of a message type starts from."""
    return 0 if number in UNSEEDED else SCHEMA


@cache
def _format(number: int, n: int) -> struct.Struct:
    parts = (f"{n if count == 'n' else count}{code}" for _, code, count in _LAYOUTS[number])
    return struct.Struct("<" + "".join(parts))


def pack(message: Message, seq: int) -> bytes:
    """Body of a message.

    Args:
        message: The message; arrays over tendons have its `n` elements.
        seq: From 0 to 65535.

    Raises:
        MessageError: A value does not fit, or an array has another length.
    """
    number, n = message.number, getattr(message, "n", 0)
    if not 0 <= n <= MOST_TENDONS:
        raise MessageError(f"a message holds 0 to {MOST_TENDONS} tendons, got {n}")
    values: list[int] = []
    for name, _, count in _LAYOUTS[number]:
        value = getattr(message, name)
        if count == 1:
            values.append(value)
            continue
        wanted = n if count == "n" else count
        if len(value) != wanted:
            raise MessageError(f"{type(message).__name__}.{name} needs {wanted} numbers")
        values.extend(value)
    try:
        return _HEADER.pack(PROTOCOL, number, seq) + _format(number, n).pack(*values)
    except struct.error as error:
        raise MessageError(f"{type(message).__name__}: {error}") from None


def unpack(body: bytes) -> tuple[Message, int]:
    """Message and sequence number of a body.

    Raises:
        MessageError: Unknown type, another protocol, or a wrong length.
    """
    if len(body) < _HEADER.size:
        raise MessageError(f"a body of {len(body)} bytes has no header")
    protocol, number, seq = _HEADER.unpack_from(body)
    if number not in TYPES:
        raise MessageError(f"unknown message type {number}")
    if protocol != PROTOCOL and number not in UNSEEDED:
        raise MessageError(f"protocol {protocol}, this is {PROTOCOL}")
    n = _count(number, body)
    layout = _format(number, n)
    if len(body) != _HEADER.size + layout.size:
        raise MessageError(f"a body of type {number} with {len(body)} bytes")
    return TYPES[number](**_named(number, n, layout.unpack_from(body, _HEADER.size))), seq


def _count(number: int, body: bytes) -> int:
    """The field `n` of a body; zero where the type has none."""
    offset = _HEADER.size
    for name, code, _ in _LAYOUTS[number]:
        if name == "n":
            n = body[offset] if offset < len(body) else MOST_TENDONS + 1
            if n > MOST_TENDONS:
                raise MessageError(f"a message holds 0 to {MOST_TENDONS} tendons, got {n}")
            return n
        offset += struct.calcsize(f"<{code}")
    return 0


def _named(number: int, n: int, values: tuple[int, ...]) -> dict[str, int | tuple[int, ...]]:
    named, at = {}, 0
    for name, _, count in _LAYOUTS[number]:
        size = n if count == "n" else count
        named[name] = values[at] if count == 1 else values[at : at + size]
        at += size
    return named
