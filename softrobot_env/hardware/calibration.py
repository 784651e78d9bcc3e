"""Finding a robot's zero, range and rest by jogging its servos."""

from dataclasses import dataclass, replace
from math import ceil, floor, isfinite, nan
from typing import Self

import numpy as np

from softrobot_env.hardware.robot_file import (
    LONGEST_PULSE,
    LONGEST_RAMP,
    SHORTEST_PULSE,
    RobotFile,
    Servo,
)

_STEP, _DIGITS = 1e-5, 5  # m, of lengths in a robot file
_LARGEST = 0.3  # m
_EXACT = 1e-6  # steps
_WATCHDOG = 0.5  # s, so that output to a slow terminal is no reason to stop
_MARKS = ("zero", "min", "max", "rest")

#: What `Calibration.obey` understands.
HELP = """\
t 2         choose tendon 2
+1.5, -0.2  pull the tendon in, or let it out, by so many mm
zero        this is length zero
min, max    this is an end of the range
rest        here a stop ends: pretensioned"""


class UnknownCommandError(ValueError):
    """A line that is no command."""


def jog_file(robot: RobotFile) -> RobotFile:
    """The robot with ranges as wide as its servos' pulses, as slow as its ramp, and patient.

    Where the way from end to end would take more than the longest ramp, they are narrower.
    """
    return replace(
        robot,
        tendons=tuple(_widest(servo, robot) for servo in robot.tendons),
        slew=min(robot.slew, robot.ramp),
        watchdog=max(robot.watchdog, _WATCHDOG),
    )


@dataclass(frozen=True)
class Calibration:
    """What has been found so far; lengths are those of the robot file that it began with.

    Attributes:
        robot: The robot as it was.
        target: (n,) [m], where the servos are to go.
        tendon: Index of the tendon that is jogged.
        marks: (n, 4) [m]: zero, minimum, maximum, rest.
        keeps_zero: Whether the board measures lengths, and so has a zero of its own.
    """

    robot: RobotFile
    target: tuple[float, ...]
    tendon: int
    marks: tuple[tuple[float, float, float, float], ...]
    keeps_zero: bool = False

    @classmethod
    def begin(cls, robot: RobotFile, present: np.ndarray, keeps_zero: bool = False) -> Self:
        """Nothing found, at the present lengths (n,) [m]."""
        marks = tuple((0.0, s.minimum, s.maximum, s.rest) for s in robot.tendons)
        return cls(robot, tuple(np.asarray(present).tolist()), 0, marks, keeps_zero)

    def obey(self, line: str) -> Self:
        """The calibration after a command, see `HELP`.

        Raises:
            UnknownCommandError: No such command.
            ValueError: No such tendon, a way that leads beyond the servo's pulses, or another zero
                than that of a board that measures lengths.
        """
        word, _, rest = line.strip().partition(" ")
        if word == "t":
            return self._choose(rest)
        if word in _MARKS:
            return self._mark(word)
        if word[:1] in ("+", "-"):
            return self._jog(word)
        raise UnknownCommandError(f"unknown command {line.strip()!r}")

    def result(self) -> RobotFile:
        """The robot as found.

        Raises:
            ValueError: What was found contradicts itself, for instance a rest out of range.
        """
        pairs = zip(self.robot.tendons, self.marks, strict=True)
        return replace(self.robot, tendons=tuple(_calibrated(*pair) for pair in pairs))

    def _choose(self, text: str) -> Self:
        count = len(self.target)
        if text not in [str(k + 1) for k in range(count)]:
            raise ValueError(f"the tendons are 1 to {count}, got {text!r}")
        return replace(self, tendon=int(text) - 1)

    def _mark(self, name: str) -> Self:
        if name == "zero" and self.keeps_zero:
            raise ValueError(
                "this board measures lengths from its own zero: set it there, see the firmware's "
                "README; the other marks can be set here"
            )
        marks = list(self.marks[self.tendon])
        marks[_MARKS.index(name)] = self.target[self.tendon]
        return replace(self, marks=_with(self.marks, self.tendon, tuple(marks)))

    def _jog(self, text: str) -> Self:
        try:
            way = 1e-3 * float(text)
        except ValueError:
            way = nan
        if not isfinite(way):
            raise ValueError(f"{text!r} is no way in mm")
        servo = _widest(self.robot.tendons[self.tendon], self.robot)
        length = self.target[self.tendon] + way
        if not servo.minimum <= length <= servo.maximum:
            raise ValueError(
                f"the servo reaches {1e3 * servo.minimum:.2f} to {1e3 * servo.maximum:.2f} mm"
            )
        return replace(self, target=_with(self.target, self.tendon, length))


def _widest(servo: Servo, robot: RobotFile) -> Servo:
    low, high = sorted(servo.length(pulse) for pulse in (SHORTEST_PULSE, LONGEST_PULSE))
    reach = LONGEST_RAMP * min(robot.ramp, robot.slew)
    room = (reach - (servo.maximum - servo.minimum)) / 2
    low = max(low, servo.minimum - room, -_LARGEST)
    high = min(high, servo.maximum + room, _LARGEST)
    # Inwards to whole steps, so that rounding leads to no longer pulse.
    low, high = ceil(low / _STEP - _EXACT), floor(high / _STEP + _EXACT)
    return replace(servo, minimum=round(low * _STEP, _DIGITS), maximum=round(high * _STEP, _DIGITS))


def _calibrated(servo: Servo, marks: tuple[float, float, float, float]) -> Servo:
    zero, minimum, maximum, rest = marks
    center = round(1e6 * servo.pulse(zero)) / 1e6
    # What zero really is, now that its pulse is whole microseconds.
    zero = servo.length(center)
    found = {"minimum": minimum - zero, "maximum": maximum - zero, "rest": rest - zero}
    return replace(servo, center=center, **{name: round(x, _DIGITS) for name, x in found.items()})


def _with(values: tuple, index: int, value: object) -> tuple:
    return (*values[:index], value, *values[index + 1 :])
