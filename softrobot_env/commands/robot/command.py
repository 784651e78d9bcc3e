"""`softrobot robot`: list the ports of real robots, send them orders, print recorded links."""

from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields
from math import inf
from time import monotonic
from typing import Any

import numpy as np
from rich.live import Live
from rich.table import Table

from softrobot_env.hardware.driver import identify
from softrobot_env.hardware.errors import RobotError
from softrobot_env.hardware.interface import Hardware
from softrobot_env.hardware.motor_file import MotorFile
from softrobot_env.hardware.protocol import messages
from softrobot_env.hardware.protocol.unit_conversion import faults
from softrobot_env.hardware.registry import HARDWARE, save_hardware
from softrobot_env.hardware.robot_file import BAUDS, rig_file
from softrobot_env.hardware.transport import (
    Direction,
    LinkLog,
    SerialTransport,
    load_serial,
    read_link_log,
)
from softrobot_env.rendering.tables import Column, make_table, named_values

from ..arguments import command
from ..output import new_file, say
from ..registry import Command
from . import calibrate, camera, record, soak, virtual
from .link import ROBOT_TEXT, numbers, open_driver, reading_rows, robot_of

EXAMPLE = "softrobot robot hold --port /dev/ttyUSB0 --seconds 10"


# ---------------------------------------------------------------- ports


def _list(args: Namespace) -> int:
    """Print the boards or motors that answer; 1 if none does.

    A few bytes are sent to every port; a board whose robot moves ramps it to rest.
    """
    answers = {port: _answer(port, args) for port in args.ports or _ports()}
    texts = {port: text for port, (_, text) in answers.items()}
    columns = Column("port", lambda port: port), Column("who answers", texts.get)
    say(make_table("", columns, texts) if answers else "This computer has no serial port.")
    return int(not any(found for found, _ in answers.values()))


def _ports() -> list[str]:
    load_serial()
    from serial.tools.list_ports import comports

    return sorted(port.device for port in comports())


def _answer(port: str, args: Namespace) -> tuple[bool, str]:
    """Whether a robot answers at a port, and its answer or the port's error."""
    try:
        transport = SerialTransport(port, args.baud)
        try:
            info = identify(transport, args.timeout)
        finally:
            transport.close()
    except RobotError as error:
        motors = _motors(port)
        return bool(motors), motors or str(error)
    return True, f"firmware {info.firmware}, {info.tendons} tendons"


def _motors(port: str) -> str:
    """The motors at a port, of all kinds that can be queried; empty if none answers."""
    for name, kind in HARDWARE.items():
        with suppress(RobotError, ImportError):
            found = kind.find(port)
            if found:
                return f"{name} {found}"
    return ""


# ---------------------------------------------------------------- orders

_LONGEST_MOVE = 30.0  # s


def _order(example: str, give: Callable[[Hardware, Namespace], int], options: str = "") -> Any:
    """A command that sends an order through a driver that has sent nothing yet."""

    def run(args: Namespace) -> int:
        with open_driver(robot_of(args), args.record) as driver:
            return give(driver, args)

    return command(example, f"{ROBOT_TEXT}\n{options}", run)


def _info(driver: Hardware, args: Namespace) -> int:
    """Print a robot's report on itself; 1 if a fault is latched."""
    driver.connect()
    robot, rows = driver.robot, driver.about | reading_rows(driver.reading)
    say(named_values(f"Robot {robot.name} at {robot.port}", rows))
    return int(bool(driver.reading.faults))


def _stop(driver: Hardware, args: Namespace) -> int:
    """Ramp to rest, then off; 1 if a fault is latched.

    On a board, a hello ends any session with the ramp; the configuration is sent afterwards.
    """
    driver.connect(args.timeout)
    driver.stop(args.timeout)
    if args.clear:
        driver.clear()
    say(named_values(f"Robot {driver.robot.name} has stopped", reading_rows(driver.reading)))
    return int(bool(driver.reading.faults))


def _estop(driver: Hardware, args: Namespace) -> int:
    """Cut the outputs at once; 1 if it cannot be confirmed."""
    driver.estop()
    driver.connect()
    # Again: a board that restarts when its port is opened has missed the first one.
    driver.estop()
    stopped = driver.wait_for_fault(1.0)
    if args.clear:
        driver.clear()
    say(named_values(f"Robot {driver.robot.name}", reading_rows(driver.reading)))
    return int(not stopped)


def _hold(driver: Hardware, args: Namespace) -> int:
    """Hold at rest; Ctrl-C ends it cleanly."""
    driver.connect()
    driver.arm()
    try:
        _stay(driver, args.seconds or inf)
    except KeyboardInterrupt:
        say("Stopping.")
    return 0


def _stay(driver: Hardware, seconds: float) -> None:
    robot = driver.robot
    rest = np.array([servo.rest for servo in robot.tendons])
    driver.move_to(rest, robot.ramp, _LONGEST_MOVE)
    end, due = monotonic() + seconds, monotonic()
    with Live(_shown(driver), get_renderable=lambda: _shown(driver)):
        while due < end:
            due = max(due, monotonic()) + robot.control_period
            driver.pace(rest, due)


def _shown(driver: Hardware) -> Table:
    link = driver.link
    trips = f"{1e3 * (link['round_trip'] or 0):.1f} ms, longest "
    trips += f"{1e3 * link['longest_round_trip']:.1f} ms"
    counts = f"{link['sent']} sent, {link['received']} received, {link['lost']} lost"
    rows = reading_rows(driver.reading) | {"round trip": trips, "messages": counts}
    return named_values(f"Robot {driver.robot.name}, Ctrl-C stops it", rows)


def _home(args: Namespace) -> int:
    """Find the zero length of motors from the tension of their tendons, and write it to a file."""
    from softrobot_env.hardware.motors import home

    robot = robot_of(args)
    if not isinstance(robot, MotorFile):
        raise ValueError("home: only motors feel their tendons; calibrate a board's servos by hand")
    with new_file(args.out, args.overwrite), open_driver(robot.jogged(), args.record) as driver:
        driver.connect()
        driver.arm()
        zero = home(driver)
        limits = zip(zero.tolist(), robot.tendons, strict=True)
        marks = [(x, x + t.minimum, x + t.maximum, x + t.rest) for x, t in limits]
        save_hardware(robot.calibrated(marks), args.robot_file, args.out)
        say(f"Length zero was at {numbers(1e3 * zero, 2)} mm; wrote {args.out}")
    return 0


# ---------------------------------------------------------------- recorded links

_ARROWS = {Direction.TO_ROBOT: "to robot", Direction.FROM_ROBOT: "from robot"}

#: Left out unless all messages are requested.
_ROUTINE = (messages.Setpoint, messages.Ping, messages.Pong)


#: A message, or what motors and their host exchanged at once: time [s] from the start, direction,
#: content.
Line = tuple[float, Direction, messages.Message | bytes]


def _replay(args: Namespace) -> int:
    """Print the messages of a link, for motors its bytes; 1 if the log ends within a record."""
    log = read_link_log(args.log)
    lines = [
        (chunk.time - log.chunks[0].time, chunk.direction, message)
        for chunk, message, _ in log.messages()
    ]
    if not lines:  # of motors: bytes sent at once are a packet, or answers
        begin = log.chunks[0].time if log.chunks else 0.0
        lines = [(chunk.time - begin, chunk.direction, chunk.data) for chunk in log.chunks]
    say(make_table("", _COLUMNS, lines if args.all else _news(lines)))
    say(_summary(log, lines))
    return int(not log.complete)


def _news(lines: list[Line]) -> Iterator[Line]:
    """Lines with new information."""
    before = None
    for line in lines:
        *_, message = line
        if isinstance(message, _ROUTINE):
            continue
        tells = _tells(message)
        if tells is None or tells != before:
            yield line
        before = tells or before


def _tells(message: messages.Message) -> tuple | None:
    """The part of a periodic message that could be new; None for other messages."""
    if isinstance(message, messages.State):
        return messages.State, message.state, message.faults, message.session
    if isinstance(message, messages.FaultReport):
        return messages.FaultReport, message.code, message.channel
    return None


def _text(message: messages.Message | bytes) -> str:
    if isinstance(message, bytes):
        return message.hex(" ")
    if isinstance(message, messages.State):
        applied = ", ".join(f"{x / 100:.2f}" for x in message.applied)
        state = messages.DeviceState(message.state).name.lower()
        stopped = ", ".join(fault.name.lower() for fault in faults(message)) or "none"
        return f"{state}, applied {applied} mm, faults {stopped}"
    if isinstance(message, messages.Nack):
        return f"message {message.about_seq}: {messages.Reason(message.reason).name.lower()}"
    if isinstance(message, messages.FaultReport):
        code = messages.Fault(message.code).name.lower()
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


_LIST = command(
    "softrobot robot list /dev/ttyUSB0 /dev/ttyUSB1",
    f"""
    ports PORT*  default: every serial port of this computer
    --baud RATE ({rig_file().baud})  out of %(choices)s
    --timeout S (2)  for each port
    """,
    _list,
    baud=BAUDS,
)
_HOLD = _order(
    "softrobot robot hold --robot-file rig.toml --seconds 10",
    _hold,
    "--seconds S  default: until Ctrl-C",
)
_STOP = _order(
    "softrobot robot stop --port /dev/ttyUSB0",
    _stop,
    "--clear  clear a latched fault, if its cause is gone\n--timeout S (10)",
)
_HOME = command(
    "softrobot robot home --robot-file trunk.toml --out homed.toml",
    f"""
    {ROBOT_TEXT}
    --out FILE (homed.toml)
    <overwrite>
    """,
    _home,
)
_ESTOP = _order(
    "softrobot robot estop --port /dev/ttyUSB0",
    _estop,
    "--clear  clear the emergency stop afterwards",
)
_REPLAY = command(
    "softrobot robot replay out/session.link --all",
    """
    log FILE  what --record has written
    --all  also set-points, and states that tell nothing new
    """,
    _replay,
)

#: The commands of `softrobot robot`.
COMMANDS: Mapping[str, Command] = {
    "list": (_LIST, "list serial ports and who answers there"),
    "info": (
        _order("softrobot robot info --robot-file rig.toml", _info),
        "configure a robot and print what it says of itself",
    ),
    "calibrate": (
        calibrate,
        "jog a robot, mark zero, range and rest, and write its file",
    ),
    "camera": (camera, "print tags and a board, calibrate a camera that sees them"),
    "home": (_HOME, "pull motors' tendons until they are taut, and write where length zero is"),
    "hold": (_HOLD, "arm a robot and hold it at rest"),
    "stop": (_STOP, "ramp a robot to rest and switch its outputs off"),
    "estop": (_ESTOP, "cut a robot's outputs at once"),
    "replay": (_REPLAY, "print what a recorded link carried"),
    "record": (record, "excite a robot, simulated, virtual or real, within limits, and record it"),
    "virtual": (virtual, "run a robot without hardware, behind a serial port"),
    "soak": (soak, "run at full rate for long, and print whether every promise was kept"),
}
