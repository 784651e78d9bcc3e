"""`softrobot robot replay`: what a recorded link carried."""

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

from rich.console import Console

from softrobot_env.hardware.protocol.messages import (
    DeviceState,
    Fault,
    FaultReport,
    Message,
    Nack,
    Ping,
    Pong,
    Reason,
    Setpoint,
    State,
)
from softrobot_env.hardware.protocol.unit_conversion import faults
from softrobot_env.hardware.transport import Direction, LinkLog, read_link_log
from softrobot_env.rendering.tables import Column, make_table

EXAMPLE = "softrobot robot replay out/session.link --all"

_ARROWS = {Direction.TO_ROBOT: "to robot", Direction.FROM_ROBOT: "from robot"}

#: Left out unless all messages are wanted.
_ROUTINE = (Setpoint, Ping, Pong)


#: A message: time [s] from the start, which way, and what.
Line = tuple[float, Direction, Message]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("log", type=Path, metavar="FILE", help="what --record has written")
    parser.add_argument(
        "--all", action="store_true", help="also set-points, and states that tell nothing new"
    )


def run(args: argparse.Namespace) -> int:
    """Run the command; 1 if the log breaks off in a record."""
    log = read_link_log(args.log)
    lines = [
        (chunk.time - log.chunks[0].time, chunk.direction, message)
        for chunk, message, _ in log.messages()
    ]
    console = Console()
    console.print(make_table("", _COLUMNS, lines if args.all else _news(lines)))
    console.print(_summary(log, lines))
    return int(not log.complete)


def _news(lines: list[Line]) -> Iterator[Line]:
    """Lines that tell of something new."""
    told = None
    for line in lines:
        *_, message = line
        if isinstance(message, _ROUTINE):
            continue
        tells = _tells(message)
        if tells is None or tells != told:
            yield line
        told = tells or told


def _tells(message: Message) -> tuple | None:
    """What of a message that comes again and again would be new; None for others."""
    if isinstance(message, State):
        return State, message.state, message.faults, message.session
    if isinstance(message, FaultReport):
        return FaultReport, message.code, message.channel
    return None


def _text(message: Message) -> str:
    if isinstance(message, State):
        applied = ", ".join(f"{x / 100:.2f}" for x in message.applied)
        state = DeviceState(message.state).name.lower()
        stopped = ", ".join(fault.name.lower() for fault in faults(message)) or "none"
        return f"{state}, applied {applied} mm, faults {stopped}"
    if isinstance(message, Nack):
        return f"message {message.about_seq}: {Reason(message.reason).name.lower()}"
    if isinstance(message, FaultReport):
        code = Fault(message.code).name.lower()
        return f"{code}, channel {message.channel}, value {message.value}"
    pairs = ((field.name, getattr(message, field.name)) for field in fields(message))
    return ", ".join(f"{name} {value}" for name, value in pairs)


#: Of the table of lines.
_COLUMNS = (
    Column("s", lambda line: line[0], ".3f"),
    Column("", lambda line: _ARROWS[line[1]]),
    Column("message", lambda line: type(line[2]).__name__),
    Column("what it says", lambda line: _text(line[2])),
)


def _summary(log: LinkLog, lines: list[Line]) -> str:
    counts = Counter(way for _, way, _ in lines)
    duration = lines[-1][0] if lines else 0.0
    end = "" if log.complete else "; the file breaks off in a record"
    return (
        f"{duration:.2f} s, {counts[Direction.TO_ROBOT]} messages to the robot, "
        f"{counts[Direction.FROM_ROBOT]} from it{end}"
    )
