"""Position servos that wind up tendons: limited speed, offset and backlash."""

from types import EllipsisType

import numpy as np
from numpy import ndarray

from softrobot_env.core.arrays import HOST, HostArrays

from .integration import layout


class Servos:
    """Servos of one robot or of many; the pull-in of a horn is the length of tendon it has wound.

    The motor turns towards the command, not faster than its speed. A gap of width `backlash` lies
    between motor and horn: the horn stays while the motor crosses it, and follows it at
    half the width behind. The horn pulls in `offset` more than it believes. How much a servo can
    pull is the scene's matter (the tendons' `tension_limit`).

    They turn while a simulation that is driven by them advances (`drive_by` of `Simulation` and
    `BatchSimulation`; `scene.integration.period` computes it).

    Attributes:
        command: (nu,) or (n, nu) [m], to be written to: held from the next period on.
        motor, horn: (nu,) or (n, nu) [m], pulled in now.
        block: (1 or n, SERVO_ROWS, nu), all that is known of them, in one piece of memory.
    """

    def __init__(
        self, speed: float | ndarray, offset: ndarray, backlash: ndarray, count: int | None = None
    ) -> None:
        """Servos at command zero.

        Args:
            speed: [m/s], or (nu,) of each.
            offset: (nu,) [m], or (n, nu).
            backlash: (nu,) [m], or (n, nu).
            count: Number n of robots; None is one, whose arrays have no axis of robots.
        """
        self._one, self.arrays = count is None, HOST
        self.block = np.zeros((count or 1, layout.SERVO_ROWS, np.shape(offset)[-1]))
        self.block[:, layout.SPEED], self.block[:, layout.OFFSET] = speed, offset
        self.block[:, layout.HALF] = np.asarray(backlash, float) / 2
        self._connect()
        self.start(0.0)

    def _connect(self) -> None:
        """Take views, which a copy has of its own."""
        rows = self.block[0] if self._one else self.block.swapaxes(0, 1)
        self._offset, self.command = rows[layout.OFFSET], rows[layout.COMMAND]
        self.motor, self.horn = rows[layout.MOTOR], rows[layout.HORN]

    def live_as(self, arrays: HostArrays) -> None:
        """Be arrays of another kind from now on."""
        self.arrays, self.block = arrays, arrays.real(self.block)
        self._connect()

    def __getstate__(self) -> dict:
        return {"_one": self._one, "block": self.block, "arrays": self.arrays}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._connect()

    def start(self, command: ndarray | float, which: ndarray | EllipsisType = ...) -> None:
        """At rest at a command, in the middle of the backlash.

        Args:
            command: (nu,) or (k, nu) [m].
            which: (k,) int, the robots; all unless given.
        """
        if which is not ...:
            which = self.arrays.index(which)
        command = self.arrays.real(command)
        self.command[which] = command
        self.motor[which] = self._offset[which] + command
        self.horn[which] = self.motor[which]

    def check_drives(self, actuation: str, shape: tuple[int, ...]) -> None:
        """Raise ValueError unless drives of an actuation take them, whose controls have a shape."""
        if actuation != "length":
            raise ValueError(f"servos drive tendons in length, and this scene's in {actuation}")
        if self.horn.shape != shape:
            raise ValueError(
                f"need servos of drives {shape}, one robot or (robots, drives), got "
                f"{self.horn.shape}"
            )

    @property
    def reading(self) -> ndarray:
        """(nu,) or (n, nu) [m], as potentiometers on the motors read: without offset and gap."""
        return self.motor - self._offset
