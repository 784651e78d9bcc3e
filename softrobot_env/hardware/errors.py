"""What can go wrong with a real robot; all texts are for people."""

from dataclasses import dataclass
from enum import IntEnum

from .protocol.messages import Reason


@dataclass(frozen=True)
class FaultInfo:
    """The first cause of a stop.

    Attributes:
        code: What happened, a `protocol.messages.Fault` or one that only a kind of motor has.
        channel: Index of the tendon, or of the converter's channel; None if it concerns neither.
        value: [m] that a servo is behind, [N] of a tendon, counts of the converter, [V] of the
            supply, [s] of silence, [A], [°C]; None if unknown.
        text: For people.
    """

    code: IntEnum
    channel: int | None
    value: float | None
    text: str


class RobotError(RuntimeError):
    """Something is wrong with a real robot or the way to it."""


class LinkError(RobotError):
    """The robot does not answer, or bytes do not get through."""


class UnansweredError(LinkError):
    """Too many set-points are under way; one more can be sent later."""


class SessionLostError(LinkError):
    """The microcontroller started again or dropped the session; only a new `connect` helps."""


class ProtocolMismatchError(RobotError):
    """Firmware and this package do not speak the same protocol."""


class RefusedError(RobotError):
    """The microcontroller refused a message.

    Attributes:
        reason: Why, as it said.
    """

    def __init__(self, what: str, reason: Reason | int) -> None:
        self.reason = reason
        super().__init__(f"the robot refuses {what}: {REASONS.get(reason, f'reason {reason}')}")


class RobotFaultError(RobotError):
    """A fault stopped the robot; `clear` it when its cause is gone.

    Attributes:
        fault: What happened.
    """

    def __init__(self, fault: FaultInfo) -> None:
        self.fault = fault
        super().__init__(f"a fault stopped the robot: {fault.text}; clear it before going on")


#: Reason of a refusal -> text.
REASONS = {
    Reason.STATE: "not in its present state",
    Reason.SESSION: "it belongs to another session",
    Reason.CONFIG: "no configuration, another one, or one that contradicts itself",
    Reason.COUNT: "another number of tendons",
    Reason.RANGE: "a value outside its range",
    Reason.FAR: "too far from its present position",
    Reason.FAULT: "a fault is latched, and its cause may still be there",
    Reason.PROTOCOL: "no handshake yet, or another protocol",
    Reason.LATE: "it came too late",
    Reason.SEQUENCE: "it is not newer than the one before",
    Reason.MODE: "an unknown mode",
}
