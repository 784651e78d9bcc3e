"""`softrobot robot virtual`: a robot without hardware, behind a serial port."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from argparse import SUPPRESS, ArgumentParser, Namespace
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread, Timer
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.artifacts import write_arrays
from softrobot_env.envs.real import RealEnv, RealRigEnv
from softrobot_env.envs.reference import SPACE
from softrobot_env.envs.simulation.virtual_rig import VirtualRig
from softrobot_env.evaluation.run import Columns
from softrobot_env.hardware.interface import HardwareFile
from softrobot_env.hardware.motor_file import usual_motors
from softrobot_env.hardware.registry import HARDWARE, hardware_of
from softrobot_env.hardware.robot_file import TRACKER_PORT, virtual_file
from softrobot_env.hardware.tip import UdpTip
from softrobot_env.hardware.transport import Transport
from softrobot_env.hardware.virtual_robot import Board, Core, VirtualRobot, linked
from softrobot_env.robots import RobotParams, default_robot, entry_of, find_robot
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.file import write_robot
from softrobot_env.robots.twin import sampled_twin, twin_of
from softrobot_env.tasks import Task

from ..arguments import declare, port
from ..output import check_free, say

EXAMPLE = """softrobot robot virtual --twin 0 --link out/robot
  softrobot robot virtual --hardware dynamixel --robot trunk.toml --link out/robot"""

#: Private flag: end when the parent process closes standard input.
_UNTIL_EOF = "--until-eof"

_SUPPLY = 6.0  # V

#: Kind of hardware that is a board.
FIRMWARE = "firmware"
_START, _END = 60.0, 30.0  # s, writing a long log takes time


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of the command."""
    text = f"""
        --hardware KIND ({FIRMWARE})  out of %(choices)s
        --robot ROBOT  of motors, any robot driven by length: its name or file; default: the rig
        --twin SEED  the built one that is simulated; default: of a board 0, of motors the nominal
        --link PATH  also make a symbolic link to the port here
        --camera-port N ({TRACKER_PORT})  UDP port of this machine that gets the camera's pictures
        --seed SEED (0)  of the noise of camera and sensors
        --seconds S  stop after this time
        --log FILE  npz with what really happened: time, tip, applied, powered, at every millisecond
    """
    declare(parser, text, camera_port=port, hardware=tuple(HARDWARE))
    parser.add_argument(_UNTIL_EOF, action="store_true", help=SUPPRESS)


def run(args: Namespace) -> int:
    """Run the command until it is stopped; 1 if the simulation failed."""
    if args.log is not None:
        check_free(args.log, overwrite=True)
    log = Columns()
    watch = None if args.log is None else lambda robot: log.add(_noted(robot))
    with closing(UdpCamera(args.camera_port)) as camera:
        with closing(_made(args, camera.show, watch)) as robot:
            _serve(args, robot)
        if args.log is not None:
            write_arrays(args.log, log.columns())
    say(f"Stopped; at most {1e3 * robot.lag:.1f} ms behind the clock")
    if robot.failure is not None:
        say(f"The simulation failed: {robot.failure}")
    return int(robot.failure is not None)


def _made(args: Namespace, *watchers: Callable | None) -> VirtualRobot:
    """The virtual robot selected by the arguments."""
    if args.hardware != FIRMWARE:
        return virtual_motors(args.hardware, args.robot, args.twin, args.seed, *watchers)
    if args.robot is not None:
        raise ValueError(f"--robot: only with motors, not with --hardware {FIRMWARE}")
    return virtual_robot(args.twin or 0, args.seed, *watchers)


def _serve(args: Namespace, robot: VirtualRobot) -> None:
    """Run a virtual robot until a signal, the end of its time or of the parent process."""
    stop = Event()
    before = {s: signal.signal(s, lambda *_: stop.set()) for s in (signal.SIGINT, signal.SIGTERM)}
    timer = Timer(args.seconds or 0.0, stop.set)
    if args.until_eof:
        Thread(target=_await_eof, args=(sys.stdin.fileno(), stop.set), daemon=True).start()
    try:
        with linked(robot.port, args.link) as port:
            say(
                f"Virtual robot of {args.hardware}, at {port}; pictures to UDP port "
                f"{args.camera_port}; stop with Ctrl-C"
            )
            if args.seconds:
                timer.start()
            robot.run(stop)
    finally:
        timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


def virtual_robot(
    twin: int,
    seed: int = 0,
    show: Callable[[float, ndarray], None] | None = None,
    watch: Callable[[VirtualRobot], None] | None = None,
) -> VirtualRobot:
    """A virtual rig with the pulse widths of `virtual_file`.

    Channels of the board drive the twin's tendons in their order.

    Args:
        twin: Seed of the twin.
        seed: Of the noise of camera and sensors.
        show, watch: See `VirtualRobot`.
    """
    servos = sorted(virtual_file().tendons, key=lambda servo: servo.channel)
    core = Core(n=len(servos), boot_id=int(np.random.default_rng().integers(1, 2**32)))
    plant = VirtualRig(sampled_twin(default_robot(on_a_line=True), twin), seed=seed)
    return VirtualRobot(Board(core, servos, _SUPPLY), plant, show, watch)


def motors_of(kind: str, robot: RobotParams, port: str) -> HardwareFile:
    """Motors of a virtual robot: its file's table of motors, with this kind."""
    if robot.hardware is not None and "motor" in robot.hardware:
        return hardware_of(robot, port, kind)
    names = [tendon.name for tendon in robot.tendons]
    travel = robot_inputs(robot).input_scale.tolist()
    return usual_motors(kind, port, names, travel, robot.drive.speed)


def virtual_motors(
    kind: str,
    which: str | RobotParams | None = None,
    twin: int | None = None,
    seed: int = 0,
    show: Callable[[float, ndarray], None] | None = None,
    watch: Callable[[VirtualRobot], None] | None = None,
) -> VirtualRobot:
    """A virtual robot whose tendons are wound by motors.

    Args:
        kind: Kind of the motors, one of `HARDWARE`.
        which: The robot, its name or file; by default the rig.
        twin: Seed of the twin; None simulates the nominal robot.
        seed, show, watch: See `virtual_robot`.

    Raises:
        ValueError: The kind has no emulator, or the robot is driven by tension.
    """
    robot = default_robot(on_a_line=True) if which is None else find_robot(which)
    if robot.drive.kind != "length":
        raise ValueError(
            f"motors wind tendons: robot {robot.name!r} is driven by tension, not by length"
        )
    device = HARDWARE.find(kind).device
    if device is None:
        raise ValueError(f"nothing emulates hardware of the kind {kind!r}")
    plant = VirtualRig(twin_of(robot, twin), seed=seed, axes=SPACE, pieces=entry_of(robot).pieces)
    motors = motors_of(kind, robot, "virtual")
    return VirtualRobot(device(motors, seed), plant, show, watch)


def _await_eof(stdin: int, then: Callable[[], None]) -> None:
    """Call a function at the end of a file, given by its descriptor."""
    while os.read(stdin, 1):
        pass
    then()


class UdpCamera:
    """Sends camera measurements as datagrams for `hardware.tip.UdpTip`."""

    def __init__(self, port: int) -> None:
        """Send to a port of this machine."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._address = ("127.0.0.1", port)

    def show(self, age: float, tip: ndarray) -> None:
        """Send a picture's age [s] and tip (2,) or (3,) [m]."""
        message = dict(zip("xyz", tip.tolist(), strict=False)) | {"age": age}
        self._socket.sendto(json.dumps(message).encode(), self._address)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _noted(robot: VirtualRobot) -> dict[str, Any]:
    """True state of a virtual robot in a tick: [s] of the host's clock, and lengths [m]."""
    time, tip = robot.moment
    device = robot.device
    return {"time": time, "tip": tip, "applied": device.applied, "powered": device.powered}


# ---------------------------------------------------------------------- for commands and tests


class Running(NamedTuple):
    """A running virtual robot: its robot file, the source of its pictures, and its process."""

    file: HardwareFile
    tip: UdpTip
    process: subprocess.Popen


@contextmanager
def virtual_process(
    twin: int | None,
    seed: int = 0,
    log: Path | None = None,
    kind: str = FIRMWARE,
    robot: RobotParams | None = None,
) -> Iterator[Running]:
    """Start `softrobot robot virtual` and stop it at the end of the context.

    It also ends when this process is killed. Ctrl-C reaches this process alone, so that a robot
    in motion is ramped down before it ends.

    Args:
        twin: Seed of the twin; None, for motors only, simulates the nominal robot.
        seed: Of the noise of camera and sensors.
        kind, robot: Kind of hardware, and for motors the robot; by default the rig.
        log: Where to write the true motion, see the command.

    Raises:
        RuntimeError: It did not start; the message contains its output.
    """
    tip = UdpTip(0)
    with TemporaryDirectory() as folder:
        link = Path(folder) / "robot"
        command = [sys.executable, "-m", "softrobot_env", "robot", "virtual"]
        command += ["--seed", str(seed), "--link", str(link), "--hardware", kind]
        command += [] if twin is None else ["--twin", str(twin)]
        if robot is not None:
            own = Path(folder) / "robot.toml"
            write_robot(robot, own)
            command += ["--robot", str(own)]
        command += ["--camera-port", str(tip.port)]
        command += [] if log is None else ["--log", str(log)]
        process = subprocess.Popen(
            [*command, _UNTIL_EOF],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            _wait_for(link, process)
            if kind == FIRMWARE:
                file = virtual_file(str(link))
            else:
                file = motors_of(kind, robot or default_robot(on_a_line=True), str(link))
            yield Running(file, tip, process)
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


class VirtualEnv(RealEnv):
    """The environment of a real robot, with a virtual one that runs as long as it exists."""

    def __init__(
        self,
        task: Task,
        twin: int | None,
        line: Callable[[HardwareFile], Callable[[], Transport]] | None = None,
        **options: Any,
    ) -> None:
        """Start a virtual robot: with motors if the file of the task's robot names their kind.

        Args:
            task: The task.
            twin: Seed of the twin.
            line: Function from the robot's file to one that opens the connection; by default its
                port.
            **options: Of `RealEnv`.
        """
        robot = task.robot
        own = {} if robot.hardware is None else {"kind": robot.hardware["kind"], "robot": robot}
        with ExitStack() as started:
            virtual = started.enter_context(virtual_process(twin, **own))
            options["line"] = None if line is None else line(virtual.file)
            super().__init__(task, robot_file=virtual.file, tip=virtual.tip, **options)
            self._process = started.pop_all()

    def close(self) -> None:
        """Ramp down, and end the process."""
        try:
            super().close()
        finally:
            self._process.close()


class VirtualRigEnv(VirtualEnv, RealRigEnv):
    """`RealRigEnv` with a virtual robot."""


def real_env(robot: RobotParams, virtual: bool) -> type[RealEnv]:
    """The environment of a robot that is real or virtual.

    Raises:
        ValueError: Its drives are not defined.
    """
    if entry_of(robot).on_a_line:
        return VirtualRigEnv if virtual else RealRigEnv
    if robot.hardware is None:
        raise ValueError(
            f"robot {robot.name!r} is only simulated: add a table [hardware] to its file "
            "(docs/howto/motors.md)"
        )
    return VirtualEnv if virtual else RealEnv
