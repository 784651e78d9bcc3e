"""A virtual robot in a process of its own, for commands and tests."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from softrobot_env.commands.robot.virtual import UNTIL_EOF
from softrobot_env.hardware.robot_file.model import RobotFile, virtual_file
from softrobot_env.hardware.tip import UdpTip

_START, _END = 60.0, 30.0  # s, a long log takes a while to write


class Running(NamedTuple):
    """A virtual robot that runs: its robot file, the source of its pictures, and its process."""

    file: RobotFile
    tip: UdpTip
    process: subprocess.Popen


@contextmanager
def virtual_process(twin: int, seed: int = 0, log: Path | None = None) -> Iterator[Running]:
    """Start `softrobot robot virtual` and stop it at the end of the context.

    It also ends when this process is killed. Ctrl-C reaches this process alone, so that a robot
    in motion is ramped down before it ends.

    Args:
        twin: Seed of the twin.
        seed: Of the noise of camera and sensors.
        log: Where to write what really happened, see the command.

    Raises:
        RuntimeError: It did not start; with what it said.
    """
    tip = UdpTip(0)
    with TemporaryDirectory() as folder:
        link = Path(folder) / "robot"
        command = [sys.executable, "-m", "softrobot_env", "robot", "virtual"]
        command += ["--twin", str(twin), "--seed", str(seed), "--link", str(link)]
        command += ["--camera-port", str(tip.port)]
        command += [] if log is None else ["--log", str(log)]
        process = subprocess.Popen(
            [*command, UNTIL_EOF],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            _wait_for(link, process)
            yield Running(virtual_file(str(link)), tip, process)
        finally:
            _end(process)
            tip.close()


def _wait_for(link: Path, process: subprocess.Popen) -> None:
    end = time.monotonic() + _START
    while not link.exists():
        if process.poll() is not None:
            raise RuntimeError(f"the virtual robot did not start: {process.stderr.read().strip()}")
        if time.monotonic() > end:
            raise RuntimeError(f"the virtual robot did not start within {_START:g} s")
        time.sleep(0.02)


def _end(process: subprocess.Popen) -> None:
    process.terminate()
    try:
        process.wait(_END)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    process.stdin.close()
    process.stderr.close()
