"""The microcontroller's program, `firmware/core`, in this process.

Its C++ sources, with those of `firmware/host`, are compiled on first use into a library of the
user's cache, which takes a second or two.
"""

import ctypes
import hashlib
import os
import shlex
import shutil
import struct
import subprocess
import weakref
from functools import cache
from pathlib import Path
from typing import NamedTuple

from softrobot_env.core.paths import cache_dir, firmware_dir
from softrobot_env.core.writing import whole
from softrobot_env.hardware.protocol.messages import (
    ADC_CHANNELS,
    MOST_TENDONS,
    Capability,
    DeviceState,
    Reset,
)

_CLOCK = 2**32  # where the device's clock wraps

#: Bytes that wait for the next pass, as in the receive buffer of a serial port.
_WAITING = 2**15
_SENT_AT_ONCE = 512  # more than the device's queue holds

_COMPILERS = ("c++", "g++", "clang++")
_FLAGS = ("-std=c++11", "-O2", "-fPIC", "-shared", "-fno-exceptions", "-fno-rtti")
_SUFFIXES = (".h", ".cpp")


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
            now_us: Time [µs], taken modulo 2**32.
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
        raw = ctypes.create_string_buffer(_OUTPUTS.size)
        self._library.softrobot_outputs(self._device, raw)
        powered, *numbers, state = _OUTPUTS.unpack(raw.raw)
        pulses, applied = numbers[: self._n], numbers[MOST_TENDONS : MOST_TENDONS + self._n]
        return Outputs(powered, tuple(pulses), tuple(applied), DeviceState(state))


#: `Outputs` and `Measured` of `firmware/core/board.h`; unlike ctypes, this refuses what does not
#: fit.
_OUTPUTS = struct.Struct(f"@?{MOST_TENDONS}H{MOST_TENDONS}hBx")
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


# ---------------------------------------------------------------------- the library


class CompilerMissingError(RuntimeError):
    """No C++ compiler, or one that cannot compile the device's program."""


@cache
def library() -> ctypes.CDLL:
    """The compiled program with the functions of `firmware/host`.

    Raises:
        CompilerMissingError: There is no C++ compiler, or it fails.
    """
    found = ctypes.CDLL(str(compiled()))
    device, byte, half, word = ctypes.c_void_p, ctypes.c_uint8, ctypes.c_uint16, ctypes.c_uint32
    data = ctypes.c_char_p
    found.softrobot_create.argtypes = (byte, word, byte, half)
    found.softrobot_create.restype = device
    found.softrobot_destroy.argtypes = (device,)
    found.softrobot_run.argtypes = (device, word, data, data, half)
    found.softrobot_transmit.argtypes = (device, data, half)
    found.softrobot_transmit.restype = half
    found.softrobot_outputs.argtypes = (device, ctypes.c_void_p)
    return found


def compiled() -> Path:
    """Path of the library; compiles if these sources never were with this compiler.

    Raises:
        CompilerMissingError: There is no C++ compiler, or it fails.
    """
    sources, compiler = _sources(), _compiler()
    path = _folder(sources, compiler) / "core.so"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        _compile([*compiler, *_FLAGS], sources, path)
    return path


def _sources() -> list[Path]:
    folders = (firmware_dir() / "core", firmware_dir() / "host")
    return sorted(p for folder in folders for p in folder.iterdir() if p.suffix in _SUFFIXES)


def _compiler() -> list[str]:
    """Command of the C++ compiler: `$CXX`, or one that is on the path."""
    chosen = shlex.split(os.environ.get("CXX", ""))
    candidates = [chosen] if chosen else [[name] for name in _COMPILERS]
    for command in candidates:
        if shutil.which(command[0]):
            return command
    named = f"; $CXX names {chosen[0]!r}, which is not there" if chosen else ""
    raise CompilerMissingError(
        "the device's program needs a C++ compiler: install one (Debian, Ubuntu: apt install g++; "
        f"Fedora: dnf install gcc-c++; macOS: xcode-select --install) or name it in $CXX{named}"
    )


def _folder(sources: list[Path], compiler: list[str]) -> Path:
    """Folder in the user's cache for what this compiler makes of these sources."""
    digest = hashlib.sha256(repr((compiler, shutil.which(compiler[0]), _FLAGS)).encode())
    for path in sources:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return cache_dir() / f"core-{digest.hexdigest()[:16]}"


def _compile(command: list[str], sources: list[Path], path: Path) -> None:
    """Compile the units; two processes may do this at once."""
    units = [str(source) for source in sources if source.suffix == ".cpp"]
    with whole(path) as aside:
        done = subprocess.run([*command, *units, "-o", str(aside)], capture_output=True, text=True)
        if done.returncode:
            raise CompilerMissingError(f"{shlex.join(command)} failed:\n{done.stderr}")
