"""What a robot says of itself, in SI units and in the order of its tendons."""

from dataclasses import dataclass

import numpy as np

from softrobot_env.hardware.protocol.messages import (
    LENGTH_UNIT,
    Capability,
    DeviceState,
    Fault,
    Reset,
    Warning,
)

_THERE = 1.5 * LENGTH_UNIT


@dataclass(frozen=True)
class DeviceInfo:
    """Who answered.

    Attributes:
        boot_id: Another number after every start.
        firmware: "major.minor".
        protocols: Oldest and newest protocol it speaks.
        schema: Hash of its table of messages.
        tendons: Number of its servos.
        capabilities: What it measures.
        reset_cause: Why it started last.
    """

    boot_id: int
    firmware: str
    protocols: tuple[int, int]
    schema: int
    tendons: int
    capabilities: Capability
    reset_cause: Reset


@dataclass(frozen=True)
class Reading:
    """A state message.

    Attributes:
        time: [s], when it arrived on the host's clock.
        taken: [s], when it was sent by the host's clock, up to the delay of the quickest message
            of the connection. A message that waited somewhere has been taken before it arrived.
        device_time: [s] of the microcontroller's clock, which wraps after 4295 s.
        seq: Last set-point of this session that it had accepted; None before the first.
        round_trip: [s] from sending that set-point; None unless this reading was its first echo.
        applied: (n,) [m], what the outputs were driven to.
        length: (n,) [m], measured; as applied if the board cannot.
        force: (n,) [N], zero if the board cannot.
        adc: (4,) counts of the converter.
        supply: [V].
        state: What it is doing.
        warnings: Does not stop it.
        faults: What stopped it, in no order.
    """

    time: float
    taken: float
    device_time: float
    seq: int | None
    round_trip: float | None
    applied: np.ndarray
    length: np.ndarray
    force: np.ndarray
    adc: np.ndarray
    supply: float
    state: DeviceState
    warnings: Warning
    faults: tuple[Fault, ...]

    def age(self, now: float) -> float:
        """How old it is [s] at `now` [s] on the host's clock."""
        return now - self.taken

    def is_at(self, length: np.ndarray) -> bool:
        """Whether the outputs have come to lengths (n,) [m], to the last step of the wire."""
        return bool(np.abs(self.applied - length).max() < _THERE)


@dataclass(frozen=True)
class FaultInfo:
    """The first cause of a stop.

    Attributes:
        code: What happened.
        channel: Index of the tendon, or of the converter's channel; None if it concerns neither.
        value: [m] that a servo is behind, [N] of a tendon, counts of the converter, [V] of the
            supply, [s] of silence; None if unknown.
        text: For people.
    """

    code: Fault
    channel: int | None
    value: float | None
    text: str
