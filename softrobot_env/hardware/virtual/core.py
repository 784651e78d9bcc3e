"""The microcontroller's program, `firmware/core`, in this process.

Its C++ sources are compiled on first use, which takes a second or two.
"""

import ctypes
import struct
import weakref
from typing import NamedTuple

from softrobot_env.hardware.protocol.messages import (
    ADC_CHANNELS,
    MOST_TENDONS,
    Capability,
    DeviceState,
    Reset,
)
from softrobot_env.hardware.virtual.core_library import CompilerMissingError, library

__all__ = ["CompilerMissingError", "Core", "Measured", "Outputs"]

_CLOCK = 2**32  # where the device's clock wraps

#: Bytes that wait for the next pass, as in the receive buffer of a serial port.
_WAITING = 2**15
_SENT_AT_ONCE = 512  # more than the device's queue holds


class Measured(NamedTuple):
    """What a board measures; without the capability a value does not matter."""

    length: tuple[int, ...]  # (n,), 0.01 mm
    force: tuple[int, ...]  # (n,), 0.01 N
    adc: tuple[int, int, int, int]
    vbus: int  # mV
    estop: bool


class Outputs(NamedTuple):
    """What a board does with its servos."""

    powered: bool
    pulse_us: tuple[int, ...]  # (n,), zero without power
    applied: tuple[int, ...]  # (n,), 0.01 mm, the lengths that the pulses stand for
    state: DeviceState


class Core:
    """One device.

    Args:
        n: Tendons, 1 to 6.
        boot_id: Tells one start of the device from another.
        reset_cause: Why it started.
        capabilities: What its board measures.

    Raises:
        CompilerMissingError: There is no C++ compiler.
        ValueError: A number does not fit.
        MemoryError: There is no memory for it.
    """

    def __init__(
        self,
        n: int = 3,
        boot_id: int = 1,
        reset_cause: Reset = Reset.POWER_ON,
        capabilities: Capability = (
            Capability.LENGTH | Capability.FORCE | Capability.ADC | Capability.SUPPLY
        ),
    ) -> None:
        if not 1 <= n <= MOST_TENDONS:
            raise ValueError(f"a device has 1 to {MOST_TENDONS} tendons, got {n}")
        if not 0 <= boot_id < 2**32:
            raise ValueError(f"boot_id must be from 0 to 2**32 - 1, got {boot_id}")
        self._n = n
        self._library = library()
        self._device = self._library.softrobot_create(
            n, boot_id, Reset(reset_cause), Capability(capabilities)
        )
        if self._device is None:
            raise MemoryError("no memory for a device")
        weakref.finalize(self, self._library.softrobot_destroy, self._device)
        self._waiting = bytearray()

    def receive(self, data: bytes) -> None:
        """Bytes from the host, cut anywhere, for the next pass. Of more than 32 KiB the rest is
        lost, as in the buffer of a serial port.
        """
        self._waiting += data[: _WAITING - len(self._waiting)]

    def run(self, now_us: int, measured: Measured) -> None:
        """One pass of the main loop.

        Args:
            now_us: Time [us], taken modulo 2**32.
            measured: What the board measures at this time.

        Raises:
            ValueError: A measured number does not fit, or there are not `n` of them.
        """
        data = bytes(self._waiting)
        image = _image(measured, self._n)
        self._library.softrobot_run(self._device, now_us % _CLOCK, image, data, len(data))
        self._waiting.clear()

    def transmit(self) -> bytes:
        """Bytes that the device wants to send; they leave its queue."""
        data = ctypes.create_string_buffer(_SENT_AT_ONCE)
        size = self._library.softrobot_transmit(self._device, data, len(data))
        return data.raw[:size]

    @property
    def outputs(self) -> Outputs:
        """What the device does with its servos since the last pass."""
        raw = _Outputs()
        self._library.softrobot_outputs(self._device, ctypes.byref(raw))
        pulses, applied = tuple(raw.pulse_us[: self._n]), tuple(raw.applied[: self._n])
        return Outputs(raw.powered, pulses, applied, DeviceState(raw.state))


class _Outputs(ctypes.Structure):
    """`Outputs` of `firmware/core/board.h`."""

    _fields_ = (
        ("powered", ctypes.c_bool),
        ("pulse_us", ctypes.c_uint16 * MOST_TENDONS),
        ("applied", ctypes.c_int16 * MOST_TENDONS),
        ("state", ctypes.c_uint8),
    )


#: `Measured` of `firmware/core/board.h`; unlike ctypes, this refuses what does not fit.
_MEASURED = struct.Struct(f"@{MOST_TENDONS}h{MOST_TENDONS}h{ADC_CHANNELS}HH?x")


def _image(measured: Measured, n: int) -> bytes:
    """`measured` as the C++ program has it in its memory."""
    length, force, adc, vbus, estop = measured
    if len(length) != n or len(force) != n or len(adc) != ADC_CHANNELS:
        wanted = f"{n} lengths, {n} forces and {ADC_CHANNELS} channels of the converter"
        raise ValueError(f"needs {wanted}, got {len(length)}, {len(force)} and {len(adc)}")
    missing = (0,) * (MOST_TENDONS - n)
    try:
        return _MEASURED.pack(*length, *missing, *force, *missing, *adc, vbus, estop)
    except struct.error as error:
        raise ValueError(f"{measured} does not fit into a device's numbers: {error}") from None
