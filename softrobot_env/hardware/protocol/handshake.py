"""The handshake: who answered a hello, and whether it fits."""

from dataclasses import dataclass

from softrobot_env.hardware.errors import ProtocolMismatchError, RobotError
from softrobot_env.hardware.protocol.messages import PROTOCOL, SCHEMA, Capability, HelloAck, Reset
from softrobot_env.hardware.robot_file import RobotFile

_REMEDY = "flash the firmware that belongs to this package"


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


def introduced(ack: HelloAck) -> DeviceInfo:
    """Who answered.

    Raises:
        ProtocolMismatchError: Another protocol, or the same with another table of messages.
    """
    firmware = f"{ack.firmware >> 8}.{ack.firmware & 255}"
    if not ack.min_protocol <= PROTOCOL <= ack.max_protocol:
        raise ProtocolMismatchError(
            f"firmware {firmware} speaks protocol {ack.min_protocol} to {ack.max_protocol}, "
            f"this package {PROTOCOL}: {_REMEDY}"
        )
    if ack.schema != SCHEMA:
        raise ProtocolMismatchError(
            f"firmware {firmware} and this package both speak protocol {PROTOCOL}, but with "
            f"different tables of messages (schema {ack.schema:08x} and {SCHEMA:08x}): {_REMEDY}"
        )
    return DeviceInfo(
        boot_id=ack.boot_id,
        firmware=firmware,
        protocols=(ack.min_protocol, ack.max_protocol),
        schema=ack.schema,
        tendons=ack.n,
        capabilities=Capability(ack.capabilities),
        reset_cause=Reset(ack.reset_cause),
    )


def check_needs(robot: RobotFile, info: DeviceInfo) -> None:
    """Refuse a board that does not fit to a robot file.

    Raises:
        RobotError: Another number of servos, or it does not measure what is to be watched.
    """
    if info.tendons != len(robot.tendons):
        raise RobotError(
            f"the board drives {info.tendons} servos, robot {robot.name!r} has "
            f"{len(robot.tendons)} tendons"
        )
    for what, key in robot.needs().items():
        if what not in info.capabilities:
            raise RobotError(
                f"robot {robot.name!r} asks for {key}, but the board does not measure "
                f"{what.name.lower()}: set it to nothing in the robot file, or use another board"
            )


def told_loss(before: DeviceInfo, now: DeviceInfo) -> str:
    """Why a session was lost, from who answered at its beginning and who answers now."""
    if before.boot_id == now.boot_id:
        return "the robot dropped the session without starting again: call connect()"
    cause = now.reset_cause.name.lower().replace("_", "-")
    return (
        f"the microcontroller started again (cause: {cause}; boot {before.boot_id:08x}, now "
        f"{now.boot_id:08x}): call connect()"
    )
