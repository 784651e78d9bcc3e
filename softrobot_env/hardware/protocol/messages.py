"""What host and microcontroller can say: messages as tables, their codes, bytes and frames.

The same tables in C++ are `firmware/core/schema.h`, which `scripts/firmware_schema.py` writes.
`SCHEMA`, a hash of these, seeds the checksum of all messages but the first two, so that programs
with different tables do not mistake each other's numbers. Names of classes, fields and codes enter
the hash: to rename one locks out every board that was flashed before.

A frame is `00 | COBS(body | CRC-32) | 00`. The leading zero keeps a truncated frame from taking the
next one with it. CRC-32 and not 16: after COBS, one flipped bit on the wire becomes several.

Lengths travel in 0.01 mm, forces in 0.01 N, times in microseconds of a clock that wraps at 2**32.
"""

import struct
from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag
from functools import cache
from itertools import islice
from struct import Struct
from typing import (
    Annotated,
    ClassVar,
    NamedTuple,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)
from zlib import crc32

PROTOCOL = 1

#: Most tendons a message can hold.
MOST_TENDONS = 6

#: Channels of the analogue-digital converter in a `State`.
ADC_CHANNELS = 4

#: A length [m], a force [N] and a time [s] of one count in a message.
LENGTH_UNIT, FORCE_UNIT, CLOCK_UNIT = 1e-5, 1e-2, 1e-6

#: Bytes of a body before its fields: protocol, type, sequence number.
HEADER_SIZE = 4

# ---------------------------------------------------------------------- codes


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

#: Every enumeration, and every set of bits; they enter the schema.
ENUMERATIONS = (DeviceState, Fault, Reset, Reason)
FLAGS = (Capability, Warning)

# ---------------------------------------------------------------------- messages

U8, U16, U32 = Annotated[int, "B"], Annotated[int, "H"], Annotated[int, "I"]
I32 = Annotated[int, "i"]
#: One number for each of the message's `n` tendons.
U16N, I16N = Annotated[tuple[int, ...], "H"], Annotated[tuple[int, ...], "h"]
#: One number for each channel of the converter.
U16ADC = Annotated[tuple[int, ...], "H", ADC_CHANNELS]


class Field(NamedTuple):
    """A field: its name, its number as `struct` codes it, and how many of them.

    A count of "n" is one for each of the message's tendons.
    """

    name: str
    code: str
    count: int | str

    def size(self, n: int) -> int:
        """How many numbers it has in a message about `n` tendons."""
        return n if self.count == "n" else self.count


#: Number of a type of message -> the type.
TYPES: dict[int, type["Message"]] = {}


@dataclass_transform(frozen_default=True)
class Message:
    """A message. Every type of it is a frozen dataclass, declared with its number.

    Attributes:
        number: Of its type.
        layout: Its fields, in the order of their bytes.
    """

    number: ClassVar[int]
    layout: ClassVar[tuple[Field, ...]]

    def __init_subclass__(cls, number: int) -> None:
        dataclass(frozen=True)(cls)
        hints = get_type_hints(cls, include_extras=True)
        cls.number = number
        cls.layout = tuple(_field(field.name, hints[field.name]) for field in fields(cls))
        TYPES[number] = cls


def _field(name: str, hint: object) -> Field:
    base, code, *count = get_args(hint)
    if get_origin(base) is not tuple:
        return Field(name, code, 1)
    return Field(name, code, count[0] if count else "n")


class Hello(Message, number=1):
    """Who is there? Ends any session; running outputs ramp down."""

    nonce: U32
    min_protocol: U8
    max_protocol: U8


class Config(Message, number=2):
    """Calibration and limits; accepted while disarmed only.

    A pulse is `center_us + gain * length`; gain is in 0.01 µs per mm. Zero in `max_force`,
    `min_force`, `stall_error` and `vbus_min` switches a check off.
    """

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


class Arm(Message, number=3):
    """Begin a session; `config_crc` is that of the last `ConfigAck`."""

    session: U16
    config_crc: U32


class Setpoint(Message, number=4):
    """Where outputs shall go; `seq` grows from one to the next. Feeds the watchdog if accepted."""

    session: U16
    t_host: U32
    ttl_ms: U16
    mode: U8
    n: U8
    target: I16N  # 0.01 mm


class Ping(Message, number=5):
    """Asks for a `Pong`; feeds nothing."""

    t_host: U32


class Stop(Message, number=6):
    """Ramp to rest, then off. A ramp of zero is the configured one."""

    session: U16
    ramp: U16


class EStop(Message, number=7):
    """Cut the outputs at once, whatever the session; latches."""


class Clear(Message, number=8):
    """Clear the latched fault, which must be named."""

    fault: U8


class Disarm(Message, number=9):
    """End the session; running outputs ramp down."""

    session: U16


class HelloAck(Message, number=65):
    """Answer to `Hello`. `boot_id` is another one after every start."""

    nonce: U32
    boot_id: U32
    firmware: U16  # major << 8 | minor
    min_protocol: U8
    max_protocol: U8
    schema: U32
    n: U8
    capabilities: U16
    reset_cause: U8


class ConfigAck(Message, number=66):
    """The configuration was accepted; `crc` is that of its fields as received."""

    crc: U32


class State(Message, number=67):
    """What the microcontroller measures and does."""

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


class Pong(Message, number=68):
    """Answer to `Ping`."""

    t_host: U32
    t_dev: U32


class FaultReport(Message, number=69):
    """The first cause of a fault; repeated while it is latched."""

    code: U8
    channel: U8
    value: I32
    t_dev: U32


class Nack(Message, number=70):
    """A message was refused."""

    about: U8  # its type
    about_seq: U16
    reason: U8


#: Types whose checksum does not depend on the schema: they tell what the other side speaks.
UNSEEDED = (Hello.number, HelloAck.number)

# ---------------------------------------------------------------------- schema


def schema_text() -> str:
    """Messages and enumerations as text, one a line; what `SCHEMA` is the hash of."""
    lines = [f"protocol {PROTOCOL}"]
    for number, kind in TYPES.items():
        parts = (f"{name}:{code}{count}" for name, code, count in kind.layout)
        lines.append(" ".join([str(number), kind.__name__, *parts]))
    for codes in (*ENUMERATIONS, *FLAGS):
        parts = (f"{code.name}={code.value}" for code in codes)
        lines.append(" ".join([codes.__name__, *parts]))
    return "\n".join(lines)


SCHEMA = crc32(schema_text().encode())


def seed(number: int) -> int:
    """What the checksum of a message type starts from."""
    return 0 if number in UNSEEDED else SCHEMA


# ---------------------------------------------------------------------- bytes

_HEADER = struct.Struct("<BBH")


class MessageError(ValueError):
    """Bytes that are no message, or values that do not fit into one."""


def pack(message: Message, seq: int) -> bytes:
    """Body of a message: `protocol u8 | type u8 | seq u16 | fields`, little-endian, without gaps.

    Args:
        message: The message; arrays over tendons have its `n` elements.
        seq: From 0 to 65535.

    Raises:
        MessageError: A value does not fit, or an array has another length.
    """
    number, n = message.number, getattr(message, "n", 0)
    _check_tendons(n)
    values: list[int] = []
    for field in message.layout:
        value = getattr(message, field.name)
        numbers = (value,) if field.count == 1 else value
        if len(numbers) != field.size(n):
            raise MessageError(
                f"{type(message).__name__}.{field.name} needs {field.size(n)} numbers"
            )
        values.extend(numbers)
    try:
        return _HEADER.pack(PROTOCOL, number, seq) + _format(number, n).pack(*values)
    except struct.error as error:
        raise MessageError(f"{type(message).__name__}: {error}") from None


def unpack(body: bytes) -> tuple[Message, int]:
    """Message and sequence number of a body.

    Raises:
        MessageError: Unknown type, another protocol, or a wrong length.
    """
    if len(body) < HEADER_SIZE:
        raise MessageError(f"a body of {len(body)} bytes has no header")
    protocol, number, seq = _HEADER.unpack_from(body)
    if number not in TYPES:
        raise MessageError(f"unknown message type {number}")
    if protocol != PROTOCOL and number not in UNSEEDED:
        raise MessageError(f"protocol {protocol}, this is {PROTOCOL}")
    kind, n = TYPES[number], _tendons(number, body)
    layout = _format(number, n)
    if len(body) != HEADER_SIZE + layout.size:
        raise MessageError(f"a body of type {number} with {len(body)} bytes")
    values = iter(layout.unpack_from(body, HEADER_SIZE))
    named = {
        field.name: next(values) if field.count == 1 else tuple(islice(values, field.size(n)))
        for field in kind.layout
    }
    return kind(**named), seq


@cache
def _format(number: int, n: int) -> struct.Struct:
    parts = (f"{field.size(n)}{field.code}" for field in TYPES[number].layout)
    return struct.Struct("<" + "".join(parts))


def _tendons(number: int, body: bytes) -> int:
    """The field `n` of a body; zero where the type has none."""
    offset = HEADER_SIZE
    for field in TYPES[number].layout:
        if field.name == "n":
            n = body[offset] if offset < len(body) else MOST_TENDONS + 1
            _check_tendons(n)
            return n
        offset += struct.calcsize(f"<{field.code}")
    return 0


def _check_tendons(n: int) -> None:
    if not 0 <= n <= MOST_TENDONS:
        raise MessageError(f"a message holds 0 to {MOST_TENDONS} tendons, got {n}")


# ---------------------------------------------------------------------- frames

#: Longest frame between its zeros [bytes]; longer ones are dropped as they arrive.
LONGEST = 160

_CRC = Struct("<I")
_TYPE = 1  # index of the message type in a body


def encode(message: Message, seq: int) -> bytes:
    """Frame of a message.

    Raises:
        MessageError: A value does not fit into the message.
    """
    from cobs import cobs

    body = pack(message, seq)
    return b"\0" + cobs.encode(body + _CRC.pack(crc32(body, seed(message.number)))) + b"\0"


class Decoder:
    """Messages out of a stream of bytes, however it is cut into pieces.

    Attributes:
        crc_errors: Frames with a wrong checksum so far.
        frame_errors: Frames that were no COBS, too long, too short, or no known message.
    """

    def __init__(self) -> None:
        self.crc_errors = self.frame_errors = 0
        self._begun = b""

    def feed(self, data: bytes) -> list[tuple[Message, int]]:
        """Messages, each with its sequence number, that these bytes complete."""
        *frames, begun = (self._begun + data).split(b"\0")
        self._begun = begun[: LONGEST + 1]  # enough to know that it is too long
        found = (self._message(frame) for frame in frames if frame)
        return [message for message in found if message is not None]

    def _message(self, frame: bytes) -> tuple[Message, int] | None:
        """What stands between two zeros; None where that is not valid."""
        from cobs import cobs

        try:
            data = cobs.decode(frame) if len(frame) <= LONGEST else b""
            body, checksum = data[: -_CRC.size], data[-_CRC.size :]
            if len(body) > _TYPE and checksum != _CRC.pack(crc32(body, seed(body[_TYPE]))):
                self.crc_errors += 1
                return None
            return unpack(body)
        except (cobs.DecodeError, MessageError):
            self.frame_errors += 1
            return None
