"""Position servos that wind up tendons: limited speed, offset, backlash, and a force if they have.

A robot's drive says which (`robots.parameters.Drive`, `integration.motors`).
"""

from math import ceil
from types import EllipsisType

import numpy as np
from numpy import ndarray

from softrobot_env.core.arrays import HOST, HostArrays
from softrobot_env.robots.twin import Twin

from .integration import layout


class Servos:
    """Servos of one robot or of many; the pull-in of a horn is the length of tendon it has wound.

    The motor turns towards the command, not faster than its speed. A gap of width `backlash` lies
    between motor and horn: the horn stays while the motor crosses it, and follows it at
    half the width behind. The horn pulls in `offset` more than it believes. How much a servo can
    pull is the scene's matter: the tendons' `tension_limit`, and what a drive with a gain has. Its
    motors move with the chain, `motor` and `horn` say where they are, and `effort` [N] what force
    their loops have.

    They turn while a simulation that is driven by them advances (`drive_by` of `Simulation` and
    `BatchSimulation`; `scene.integration.period` computes it).

    Attributes:
        command: (nu,) or (n, nu) [m], to be written to: held from the next period on, or after
            the dead time.
        motor, horn: (nu,) or (n, nu) [m], pulled in now.
        block: (1 or n, SERVO_ROWS, nu), all that is known of them, in one piece of memory.
    """

    def __init__(
        self,
        speed: float | ndarray,
        offset: ndarray,
        backlash: ndarray,
        count: int | None = None,
        dead_time: float = 0.0,
        control_period: float = 1.0,
    ) -> None:
        """Servos at command zero.

        Args:
            speed: [m/s], or (nu,) of each.
            offset: (nu,) [m], or (n, nu).
            backlash: (nu,) [m], or (n, nu).
            count: Number n of robots; None is one, whose arrays have no axis of robots.
            dead_time: [s], from a command to servos with a gain.
            control_period: [s], of the simulation that they drive.
        """
        self._one, self.arrays, self._layers = count is None, HOST, 0.0
        before = ceil(dead_time / control_period - 1e-9)
        rows = layout.SERVO_ROWS + before
        self.block = np.zeros((count or 1, rows, np.shape(offset)[-1]))
        self.block[:, layout.LATE] = dead_time - max(before - 1, 0) * control_period
        self.block[:, layout.SPEED], self.block[:, layout.OFFSET] = speed, offset
        self.block[:, layout.HALF] = np.asarray(backlash, float) / 2
        self._connect()
        self.start(0.0)

    @classmethod
    def of(cls, twin: Twin, control_period: float, count: int | None = None) -> "Servos":
        """Those of a robot as built, or of `count` such robots."""
        drive = twin.robot.drive
        speed, late = twin.servo_speed, drive.command_delay
        servos = cls(speed, twin.servo_offset, twin.backlash, count, late, control_period)
        servos._layers = drive.layers
        return servos

    def _connect(self) -> None:
        """Take views, which a copy has of its own."""
        rows = self.block[0] if self._one else self.block.swapaxes(0, 1)
        self._offset, self.command = rows[layout.OFFSET], rows[layout.COMMAND]
        self.motor, self.horn = rows[layout.MOTOR], rows[layout.HORN]
        self.turning, self.effort = rows[layout.TURNING], rows[layout.EFFORT]
        self._before = rows[layout.SERVO_ROWS :]

    def live_as(self, arrays: HostArrays) -> None:
        """Be arrays of another kind from now on."""
        self.arrays, self.block = arrays, arrays.real(self.block)
        self._connect()

    def __getstate__(self) -> dict:
        return {name: getattr(self, name) for name in ("_one", "block", "arrays", "_layers")}

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
        self.turning[which] = np.nan  # a simulation places motors that have a force
        for commands in self._before:
            commands[which] = command

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
    def pulled(self) -> ndarray:
        """(nu,) or (n, nu) [m], length of tendon that horns have wound."""
        if not self._layers:
            return self.arrays.copy(self.horn)
        return self.horn + self._layers * self.horn * self.horn

    @property
    def reading(self) -> ndarray:
        """(nu,) or (n, nu) [m], as potentiometers on the motors read: without offset and gap.

        Turns by the bare radius of the spool.
        """
        return self.motor - self._offset
