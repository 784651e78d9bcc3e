"""Between SI units by tendon, and whole numbers by channel of the board."""

from typing import NamedTuple

import numpy as np

from softrobot_env.hardware.protocol.messages import (
    CLOCK_UNIT,
    FORCE_UNIT,
    LENGTH_UNIT,
    DeviceState,
    Fault,
    FaultReport,
    State,
    Warning,
)
from softrobot_env.hardware.protocol.readings import FaultInfo, Reading
from softrobot_env.hardware.robot_file.model import RobotFile

_MILLI = 1e-3

#: Fault -> unit of its value in SI, and what happened; `who` is a tendon or a channel.
_FAULTS = {
    Fault.WATCHDOG: (_MILLI, "no set-point for {value:.3g} s"),
    Fault.ESTOP: (None, "emergency stop"),
    Fault.FORCE: (FORCE_UNIT, "tendon {who} pulled with {value:.2f} N"),
    Fault.SLACK: (FORCE_UNIT, "tendon {who} is loose at {value:.2f} N"),
    Fault.STALL: (LENGTH_UNIT, "tendon {who} stalled {millimetres:.1f} mm behind"),
    Fault.ADC: (1.0, "channel {channel} of the converter stands at {value:.0f}"),
    Fault.BROWN_OUT: (_MILLI, "supply fell to {value:.2f} V"),
}

_KINDS = {
    Fault.WATCHDOG: "no set-point in time",
    Fault.ESTOP: "emergency stop",
    Fault.FORCE: "a tendon pulled too hard",
    Fault.SLACK: "a tendon is loose",
    Fault.STALL: "a servo stalled",
    Fault.ADC: "a channel of the converter is at a rail",
    Fault.BROWN_OUT: "supply too low",
}

_OF_TENDONS = (Fault.FORCE, Fault.SLACK, Fault.STALL)


class Arrival(NamedTuple):
    """When a message arrived and when it was sent [s], see `Reading`."""

    time: float
    taken: float


class Wire:
    """Translates for one robot."""

    def __init__(self, robot: RobotFile) -> None:
        config = robot.to_message()
        self._least, self._most = np.array(config.minimum), np.array(config.maximum)
        # channel of each tendon; its inverse is the tendon on each channel
        self._channels = np.array([servo.channel for servo in robot.tendons])
        self._tendons = np.argsort(self._channels)

    def target(self, length: np.ndarray) -> tuple[int, ...]:
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
            raise ValueError(self._outside(wrong[0], counts))
        return tuple(counts.tolist())

    def nearest_target(self, length: np.ndarray) -> np.ndarray:
        """Lengths (n,) [m] inside the range that are nearest to (n,) [m]."""
        least, most = self._least[self._channels], self._most[self._channels]
        return np.clip(length, least * LENGTH_UNIT, most * LENGTH_UNIT)

    def reading(
        self, state: State, arrival: Arrival, seq: int | None, round_trip: float | None
    ) -> Reading:
        """What a state message says; `seq` and `round_trip` as in `Reading`."""
        return Reading(
            time=arrival.time,
            taken=arrival.taken,
            device_time=state.t_dev * CLOCK_UNIT,
            seq=seq,
            round_trip=round_trip,
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
        unit, text = _FAULTS[code]
        value = None if unit is None else abs(report.value) * unit
        channel, who = report.channel, report.channel
        if code in _OF_TENDONS:
            channel = int(self._tendons[report.channel])
            who = channel + 1
        elif code != Fault.ADC:
            channel = None
        told = {"value": value, "channel": channel, "who": who}
        told["millimetres"] = 1e3 * value if value is not None else None
        return FaultInfo(code, channel, value, text.format(**told))

    def _by_tendon(self, values: tuple[int, ...], unit: float) -> np.ndarray:
        return np.array(values)[self._channels] * unit

    def _outside(self, channel: int, counts: np.ndarray) -> str:
        value, least, most = (x[channel] / 100 for x in (counts, self._least, self._most))
        return (
            f"tendon {self._tendons[channel] + 1}: {value:.2f} mm is outside its range of "
            f"{least:.2f} to {most:.2f} mm"
        )


def faults(state: State) -> tuple[Fault, ...]:
    """Faults whose bits are set."""
    return tuple(fault for fault in Fault if fault and state.faults >> fault & 1)


def kind_of_fault(code: Fault) -> FaultInfo:
    """A fault of which only the kind is known."""
    return FaultInfo(code, None, None, _KINDS[code])
