"""A virtual robot: the microcontroller's own program behind a pseudo-terminal, in real time."""

import contextlib
import os
import select
import tty
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from threading import Event
from time import monotonic
from typing import Protocol

import numpy as np

from softrobot_env.hardware.protocol.messages import FORCE_UNIT, LENGTH_UNIT
from softrobot_env.hardware.robot_file import Servo
from softrobot_env.hardware.virtual.core import Core, Measured, Outputs

_READ = 4096  # bytes at once
_MOST_PENDING = 4096  # bytes that a host has not read; what comes later is lost, as on a wire
_LONGEST_LAG = 0.25  # s behind the clock, after which a robot gives up catching up

_CLOCK = 2**32


class Plant(Protocol):
    """What the microcontroller drives and measures.

    Attributes:
        tick: [s] of an `advance`.
        picture: Age [s] and tip (2,) [m] of the camera's picture that is new since the last tick,
            or None.
    """

    tick: float
    picture: tuple[float, np.ndarray] | None

    @property
    def length(self) -> np.ndarray:
        """Positions (n,) [m] of the servos."""

    @property
    def tension(self) -> np.ndarray:
        """(n,) [N]."""

    @property
    def tip(self) -> np.ndarray:
        """Where the tip is, (2,) [m]."""

    def adc(self) -> tuple[int, ...]:
        """Counts of the converter's first channels."""

    def advance(self, command: np.ndarray | None) -> str | None:
        """Go on for a tick with servos driven to (n,) [m], or without power; what went wrong."""


class VirtualRobot:
    """Microcontroller, plant and camera, run by the clock.

    Attributes:
        port: Path of the pseudo-terminal that hosts open.
        outputs: What the microcontroller drives now.
        failure: Why the plant's simulation stopped, or None.
        lag: [s], farthest that the simulation has been behind the clock.
    """

    def __init__(
        self,
        core: Core,
        plant: Plant,
        servos: Sequence[Servo],
        supply: float,
        show: Callable[[float, np.ndarray], None] | None = None,
        watch: Callable[["VirtualRobot"], None] | None = None,
    ) -> None:
        """Open a pseudo-terminal; nothing runs yet.

        Args:
            core: The microcontroller's program.
            plant: What it drives.
            servos: How the plant's servos understand pulses.
            supply: [V].
            show: Called with age [s] and tip (2,) [m] of every picture of the camera.
            watch: Called after every tick.
        """
        self._core, self._plant, self._servos = core, plant, servos
        self._millivolts = round(1e3 * supply)
        self._show, self._watch = show, watch
        # The slave stays open, so that a host may come and go.
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self.outputs: Outputs = core.outputs
        self.failure: str | None = None
        self.lag = 0.0
        self._pending, self._passed = b"", monotonic()
        self._measured = self._measure()

    def run(self, stop: Event) -> None:
        """Serve until `stop` is set or the plant fails."""
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
    def moment(self) -> tuple[float, np.ndarray]:
        """Time [s] of the host's clock that `outputs` are of, and where the tip is, (2,) [m]."""
        return self._passed, self._plant.tip

    def close(self) -> None:
        """Close the pseudo-terminal."""
        for end in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(end)

    def _serve_until(self, due: float) -> None:
        """Answer the host at once, whenever it says something, until `due` [s]."""
        while True:
            left = due - monotonic()
            waiting = [self._master] if self._pending else []
            readable, _, _ = select.select([self._master], waiting, [], max(0.0, left))
            if readable:
                with contextlib.suppress(OSError):
                    self._core.receive(os.read(self._master, _READ))
            self._pass()
            if left <= 0:
                return

    def _pass(self) -> None:
        """One pass of the microcontroller's main loop."""
        self._passed = monotonic()
        self._core.run(round(1e6 * self._passed) % _CLOCK, self._measured)
        self.outputs = self._core.outputs
        self._pending += self._core.transmit()
        if self._pending:
            with contextlib.suppress(BlockingIOError):
                self._pending = self._pending[os.write(self._master, self._pending) :]
            if len(self._pending) > _MOST_PENDING:
                self._pending = b""

    def _advance(self) -> None:
        command = None
        if self.outputs.powered:
            pairs = zip(self._servos, self.outputs.pulse_us, strict=True)
            command = np.array([servo.length(1e-6 * pulse) for servo, pulse in pairs])
        self.failure = self._plant.advance(command)
        self._measured = self._measure()
        if self._show is not None and self._plant.picture is not None:
            self._show(*self._plant.picture)
        if self._watch is not None:
            self._watch(self)

    def _measure(self) -> Measured:
        plant = self._plant
        return Measured(
            length=tuple(round(x / LENGTH_UNIT) for x in plant.length.tolist()),
            force=tuple(round(x / FORCE_UNIT) for x in plant.tension.tolist()),
            adc=plant.adc(),
            vbus=self._millivolts,
            estop=False,
        )


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
    _remove_dead(link)
    link.symlink_to(port)
    try:
        yield str(link)
    finally:
        if link.is_symlink() and str(link.readlink()) == port:
            link.unlink()


def _remove_dead(link: Path) -> None:
    if not link.is_symlink():
        return
    if link.exists():
        raise FileExistsError(
            f"{link} leads to {link.readlink()}: another virtual robot is there; end it, choose "
            f"another name, or remove the link if that is something else"
        )
    link.unlink()
