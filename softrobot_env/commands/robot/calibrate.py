"""`softrobot robot calibrate`: jog the servos, mark zero, range and rest, write a robot file."""

import sys
from argparse import Namespace
from collections.abc import Iterable
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from time import monotonic

import numpy as np

from softrobot_env.hardware.interface import Hardware
from softrobot_env.hardware.registry import save_hardware
from softrobot_env.hardware.robot_file import HELP, Calibration, UnknownCommandError

from ..output import new_file, say
from .link import ROBOT_TEXT, numbers, open_driver, robot_of

EXAMPLE = "softrobot robot calibrate --port /dev/ttyUSB0 --out rig.toml"

_HELP = f"""\
{HELP}
write       write the file and stop
quit        stop without a file"""


ARGUMENTS = f"""
    {ROBOT_TEXT}
    --out FILE (robot.toml)
    <overwrite>
"""


def run(args: Namespace) -> int:
    """Run the command; 1 if no file was written.

    Raises:
        FileExistsError: The file to write exists; the robot has not moved.
    """
    robot = robot_of(args)
    with new_file(args.out, args.overwrite), open_driver(robot.jogged(), args.record) as driver:
        driver.connect()
        say(_HELP, highlight=False)
        driver.arm()
        begun = Calibration.begin(robot, driver.reading.applied, driver.keeps_zero)
        written = jog(driver, begun, _Lines(sys.stdin), args.out, args.robot_file)
    say(f"Wrote {args.out}" if written else "Nothing written.")
    return int(not written)


class _Lines:
    """Lines typed by a user, read without blocking."""

    def __init__(self, lines: Iterable[str]) -> None:
        self._queue: SimpleQueue[str] = SimpleQueue()
        Thread(target=self._read, args=(lines,), daemon=True).start()

    def poll(self) -> str | None:
        """The next line, None if there is none yet; "quit" at the end."""
        try:
            return self._queue.get_nowait()
        except Empty:
            return None

    def _read(self, lines: Iterable[str]) -> None:
        for line in lines:
            self._queue.put(line.strip())
        self._queue.put("quit")


def jog(
    driver: Hardware,
    calibration: Calibration,
    lines: _Lines,
    out: Path,
    source: Path | None = None,
) -> bool:
    """Move an armed robot by the commands in the lines, until a file is written or until "quit".

    A line is executed once the robot has finished the motion of the previous one.

    Returns:
        Whether the file was written.
    """
    due = monotonic()
    while True:
        due = max(due, monotonic()) + driver.robot.control_period
        reading = driver.pace(np.array(calibration.target), due)
        if reading is None or not reading.is_at(calibration.target):
            continue
        line = lines.poll()
        if line == "quit":
            return False
        if line == "write":
            if _write(calibration, source, out):
                return True
        elif line:
            calibration = _obey(calibration, line)


def _write(calibration: Calibration, source: Path | None, out: Path) -> bool:
    """Write the calibration; errors in it are reported and can be corrected."""
    try:
        save_hardware(calibration.result(), source, out)
    except (ValueError, OSError) as error:
        say(f"not written: {error}", highlight=False)
        return False
    return True


def _obey(calibration: Calibration, line: str) -> Calibration:
    try:
        found = calibration.obey(line)
    except UnknownCommandError as error:
        say(f"{error}; there are:\n{_HELP}", highlight=False)
        return calibration
    except ValueError as error:
        say(str(error), highlight=False)
        return calibration
    say(f"tendon {found.tendon + 1}; targets {numbers(1e3 * np.array(found.target), 2)} mm")
    return found
