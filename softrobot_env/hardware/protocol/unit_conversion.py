"""Between SI units by tendon, and the whole numbers by channel of the board that messages carry."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from ..interface import FaultInfo, Reading
from ..robot_file import RobotFile
from .messages import (
    CLOCK_UNIT,
    FORCE_UNIT,
    LENGTH_UNIT,
    DeviceState,
    Fault,
    FaultReport,
    Message,
    State,
    Warning,
)

_MILLI = 1e-3


class _Report(NamedTuple):
    """What is reported of a fault.

    Attributes:
        unit: Of its value in SI, None where it has none.
        report: What happened; `who` is a tendon or a channel.
        kind: The same as long as its report has not come.
    """

    unit: float | None
    report: str
    kind: str


_FAULTS = {
    Fault.WATCHDOG: _Report(_MILLI, "no set-point for {value:.3g} s", "no set-point in time"),
    Fault.ESTOP: _Report(None, "emergency stop", "emergency stop"),
    Fault.FORCE: _Report(
        FORCE_UNIT, "tendon {who} pulled with {value:.2f} N", "a tendon pulled too hard"
    ),
    Fault.SLACK: _Report(FORCE_UNIT, "tendon {who} is loose at {value:.2f} N", "a tendon is loose"),
    Fault.STALL: _Report(
        LENGTH_UNIT, "tendon {who} stalled {millimetres:.1f} mm behind", "a servo stalled"
    ),
    Fault.ADC: _Report(
        1.0,
        "channel {channel} of the converter stands at {value:.0f}",
        "a channel of the converter is at a rail",
    ),
    Fault.BROWN_OUT: _Report(_MILLI, "supply fell to {value:.2f} V", "supply too low"),
}

_OF_TENDONS = (Fault.FORCE, Fault.SLACK, Fault.STALL)


class UnitConversion:
    """Converts for one robot: SI units by tendon there, whole numbers by channel here."""

    def __init__(self, robot: RobotFile) -> None:
        config = robot.to_message()
        self._least, self._most = np.array(config.minimum), np.array(config.maximum)
        # channel of each tendon; its inverse is the tendon on each channel
        self._channels = np.array([servo.channel for servo in robot.tendons])
        self._tendons = np.argsort(self._channels)

    def knows(self, message: Message) -> bool:
        """Whether codes and counts of a message mean something for this robot."""
        n = len(self._channels)
        if isinstance(message, State):
            return message.n == n and message.state in list(DeviceState)
        if isinstance(message, FaultReport):
            whose = message.channel < n or message.code not in _OF_TENDONS
            return message.code in _FAULTS and whose
        return True

    def target(self, length: ndarray) -> tuple[int, ...]:
        """Set-point of pulled-in lengths (n,) [m].

        Raises:
            ValueError: Another shape, or a length outside the robot file's range.
        """
        length = np.asarray(length, float)
        if length.shape != self._channels.shape or not np.isfinite(length).all():
            raise ValueError(
                f"a set-point needs {len(self._channels)} finite lengths [m], got {length}"
            )
        counts = np.rint(length / LENGTH_UNIT).astype(int)[self._tendons]
        wrong = np.flatnonzero((counts < self._least) | (counts > self._most))
        if wrong.size:
            k = wrong[0]
            value, least, most = (x[k] / 100 for x in (counts, self._least, self._most))
            raise ValueError(
                f"tendon {self._tendons[k] + 1}: {value:.2f} mm is outside its range of "
                f"{least:.2f} to {most:.2f} mm"
            )
        return tuple(counts.tolist())

    def nearest_target(self, length: ndarray) -> ndarray:
        """Lengths (n,) [m] inside the range that are nearest to (n,) [m]."""
        least, most = self._least[self._channels], self._most[self._channels]
        return np.clip(length, least * LENGTH_UNIT, most * LENGTH_UNIT)

    def reading(self, state: State, **received: float | None) -> Reading:
        """What a state message says, with `time`, `taken`, `seq` and `round_trip` of `Reading`."""
        return Reading(
            **received,
            device_time=state.t_dev * CLOCK_UNIT,
            applied=self._by_tendon(state.applied, LENGTH_UNIT),
            length=self._by_tendon(state.length, LENGTH_UNIT),
            force=self._by_tendon(state.force, FORCE_UNIT),
            adc=np.array(state.adc),
            supply=state.vbus * _MILLI,
            state=DeviceState(state.state),
            warnings=Warning(state.warnings),
            faults=faults(state),
        )

    def fault(self, report: FaultReport) -> FaultInfo:
        """A fault as the microcontroller reports it."""
        code = Fault(report.code)
        unit, text, _ = _FAULTS[code]
        value = None if unit is None else abs(report.value) * unit
        channel, who = report.channel, report.channel
        if code in _OF_TENDONS:
            channel = int(self._tendons[report.channel])
            who = channel + 1
        elif code != Fault.ADC:
            channel = None
        said = text.format(value=value, channel=channel, who=who, millimetres=1e3 * (value or 0.0))
        return FaultInfo(code, channel, value, said)

    def _by_tendon(self, values: tuple[int, ...], unit: float) -> ndarray:
        return np.array(values)[self._channels] * unit


def faults(state: State) -> tuple[Fault, ...]:
    """Faults whose bits are set."""
    return tuple(fault for fault in Fault if fault and state.faults >> fault & 1)


def kind_of_fault(code: Fault) -> FaultInfo:
    """A fault of which only the kind is known."""
    return FaultInfo(code, None, None, _FAULTS[code].kind)
