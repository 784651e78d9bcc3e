"""A virtual robot: the microcontroller's own program behind a pseudo-terminal, in real time.

The C++ sources of `firmware/core`, with those of `firmware/host`, are compiled on first use into a
library of the user's cache, which takes a second or two.
"""

import contextlib
import ctypes
import gc
import hashlib
import os
import select
import shlex
import shutil
import struct
import subprocess
import tty
import weakref
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from math import inf
from pathlib import Path
from threading import Event
from time import monotonic
from typing import NamedTuple, Protocol

import numpy as np
from numpy import ndarray

from softrobot_env.core.files import atomic_write, cache_dir, firmware_dir, readable

from .protocol.messages import (
    ADC_CHANNELS,
    FORCE_UNIT,
    LENGTH_UNIT,
    MOST_TENDONS,
    Capability,
    DeviceState,
    Reset,
)
from .robot_file import Servo

_READ = 4096  # bytes at once
_MOST_PENDING = 4096  # bytes that a host has not read; what comes later is lost, as on a wire
_LONGEST_LAG = 0.25  # s behind the clock, after which a robot gives up catching up

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
    compiler, folders = _compiler(), (firmware_dir() / "core", firmware_dir() / "host")
    sources = sorted(p for folder in folders for p in folder.iterdir() if p.suffix in _SUFFIXES)
    digest = hashlib.sha256(repr((compiler, shutil.which(compiler[0]), _FLAGS)).encode())
    for source in sources:
        digest.update(source.name.encode() + b"\0" + readable(source).read_bytes())
    path = cache_dir() / f"core-{digest.hexdigest()[:16]}" / "core.so"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        command = [*compiler, *_FLAGS]
        units = [str(source) for source in sources if source.suffix == ".cpp"]
        with atomic_write(path) as aside:  # two processes may do this at once
            whole = [*command, *units, "-o", str(aside)]
            done = subprocess.run(whole, capture_output=True, text=True)
            if done.returncode:
                raise CompilerMissingError(f"{shlex.join(command)} failed:\n{done.stderr}")
    return path


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


# ---------------------------------------------------------------------- the robot


class Plant(Protocol):
    """What the microcontroller drives and measures.

    Attributes:
        tick: [s] of an `advance`.
        picture: Age [s] and tip (d,) [m] of the camera's picture that is new since the last tick,
            or None.
    """

    tick: float
    picture: tuple[float, ndarray] | None

    @property
    def length(self) -> ndarray:
        """Positions (n,) [m] of the servos."""

    @property
    def tension(self) -> ndarray:
        """(n,) [N]."""

    @property
    def tip(self) -> ndarray:
        """Where the tip is, (d,) [m]."""

    def adc(self) -> tuple[int, ...]:
        """Counts of the converter's first channels."""

    def advance(self, command: ndarray | None) -> str | None:
        """Go on for a tick with servos driven to (n,) [m], or without power; what went wrong."""


class Device(Protocol):
    """What hosts talk to: a board's program, or motors on a bus.

    Attributes:
        command: (n,) [m], where it drives the servos; None without power: then they stay.
        applied: (n,) [m], what it takes its outputs to be.
        powered: Whether any output is on.
        due: [s], when its next bytes leave without being asked.
    """

    command: ndarray | None
    applied: ndarray
    powered: bool
    due: float

    def receive(self, data: bytes) -> None:
        """Bytes from the host, cut anywhere, for the next pass."""

    def run(self, now: float, plant: Plant) -> None:
        """One pass of its program, at a time [s]."""

    def transmit(self) -> bytes:
        """Bytes that have left it by the last pass."""


class Board:
    """A microcontroller with its servos; see `Device`."""

    due = inf

    def __init__(self, core: Core, servos: Sequence[Servo], supply: float) -> None:
        """A board.

        Args:
            core: The microcontroller's program.
            servos: How the plant's servos understand pulses.
            supply: [V].
        """
        self.core, self._servos, self._millivolts = core, servos, round(1e3 * supply)
        self.receive, self.transmit = core.receive, core.transmit
        self.outputs = core.outputs

    def run(self, now: float, plant: Plant) -> None:
        """See `Device`."""
        measured = Measured(
            length=tuple(round(x / LENGTH_UNIT) for x in plant.length.tolist()),
            force=tuple(round(x / FORCE_UNIT) for x in plant.tension.tolist()),
            adc=plant.adc(),
            vbus=self._millivolts,
            estop=False,
        )
        self.core.run(round(1e6 * now) % _CLOCK, measured)
        self.outputs = self.core.outputs

    @property
    def command(self) -> ndarray | None:
        """See `Device`."""
        if not self.outputs.powered:
            return None
        pairs = zip(self._servos, self.outputs.pulse_us, strict=True)
        return np.array([servo.length(1e-6 * pulse) for servo, pulse in pairs])

    @property
    def applied(self) -> ndarray:
        """See `Device`."""
        return LENGTH_UNIT * np.array(self.outputs.applied)

    @property
    def powered(self) -> bool:
        """See `Device`."""
        return self.outputs.powered


class VirtualRobot:
    """A device, plant and camera, run by the clock.

    Attributes:
        port: Path of the pseudo-terminal that hosts open.
        device: What hosts talk to.
        failure: Why the plant's simulation stopped, or None.
        lag: [s], farthest that the simulation has been behind the clock.
    """

    def __init__(
        self,
        device: Device,
        plant: Plant,
        show: Callable[[float, ndarray], None] | None = None,
        watch: Callable[["VirtualRobot"], None] | None = None,
    ) -> None:
        """Open a pseudo-terminal; nothing runs yet.

        Args:
            device: What hosts talk to.
            plant: What it drives.
            show: Called with age [s] and tip (d,) [m] of every picture of the camera.
            watch: Called after every tick.
        """
        self.device, self._plant = device, plant
        self._show, self._watch = show, watch
        # The slave stays open, so that a host may come and go.
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self.failure: str | None = None
        self.lag = 0.0
        self._pending, self._passed = b"", monotonic()

    def run(self, stop: Event) -> None:
        """Serve until `stop` is set or the plant fails."""
        gc.collect()
        gc.freeze()  # a full collection would stall the line
        try:
            self._run(stop)
        finally:
            gc.unfreeze()

    def _run(self, stop: Event) -> None:
        due = monotonic()
        while not stop.is_set() and self.failure is None:
            due += self._plant.tick
            self._serve_until(due)
            behind = monotonic() - due
            self.lag = max(self.lag, behind)
            if behind > _LONGEST_LAG:
                due = monotonic()
            self._advance()

    @property
    def moment(self) -> tuple[float, ndarray]:
        """Time [s] of the host's clock that outputs are of, and where the tip is, (d,) [m]."""
        return self._passed, self._plant.tip

    def close(self) -> None:
        """Close the pseudo-terminal."""
        for end in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(end)

    def _serve_until(self, due: float) -> None:
        """Answer the host at once, whenever it says something, until `due` [s]."""
        while True:
            now = monotonic()
            left, idle = due - now, min(due, self.device.due) - now
            waiting = [self._master] if self._pending else []
            readable, _, _ = select.select([self._master], waiting, [], max(0.0, idle))
            if readable:
                with contextlib.suppress(OSError):
                    self.device.receive(os.read(self._master, _READ))
            self._pass()
            if left <= 0:
                return

    def _pass(self) -> None:
        """One pass of the device's program."""
        self._passed = monotonic()
        self.device.run(self._passed, self._plant)
        self._pending += self.device.transmit()
        if self._pending:
            with contextlib.suppress(BlockingIOError):
                self._pending = self._pending[os.write(self._master, self._pending) :]
            if len(self._pending) > _MOST_PENDING:
                self._pending = b""

    def _advance(self) -> None:
        self.failure = self._plant.advance(self.device.command)
        if self._show is not None and self._plant.picture is not None:
            self._show(*self._plant.picture)
        if self._watch is not None:
            self._watch(self)


@contextlib.contextmanager
def linked(port: str, link: Path | None) -> Iterator[str]:
    """A symbolic link to a port, for as long as the context lasts; none if `link` is None.

    A link that leads nowhere, as a virtual robot leaves it that was killed, is replaced.

    Raises:
        OSError: There is a file of that name, or a link to something that exists.
    """
    if link is None:
        yield port
        return
    link.parent.mkdir(parents=True, exist_ok=True)
    if link.is_symlink():
        if link.exists():
            raise FileExistsError(
                f"{link} leads to {link.readlink()}: another virtual robot is there; end it, "
                "choose another name, or remove the link if that is something else"
            )
        link.unlink()
    link.symlink_to(port)
    try:
        yield str(link)
    finally:
        if link.is_symlink() and str(link.readlink()) == port:
            link.unlink()
