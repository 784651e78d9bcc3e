"""Boards without a robot: the firmware's core with servos that go where they are driven."""

import errno
import os
import select
import threading
import time
import tty
from contextlib import suppress
from queue import Empty, SimpleQueue

import numpy as np
from support.rough_lines import Line

from softrobot_env.hardware.errors import LinkError
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.session import Session
from softrobot_env.hardware.robot_file import rig_file
from softrobot_env.hardware.virtual_robot import Core, Measured

PASS = 1e-3  # s, of a board's main loop


def state(**fields):
    """What a board of three tendons at rest says, but for some fields."""
    usual = {"t_dev": 0, "last_seq": 0, "t_host_echo": 0, "n": 3, "session": 0}
    usual |= {"applied": (0,) * 3, "length": (0,) * 3, "force": (0,) * 3, "adc": (0,) * 4}
    usual |= {"vbus": 6000, "crc_errors": 0, "frame_errors": 0, "faults": 0, "warnings": 0}
    return m.State(**usual | fields)


class Board:
    """A core whose servos are ideal, unless they are stuck.

    Attributes:
        core: The program of the microcontroller.
        stuck: Positions (n,) [0.01 mm] that the servos stay at, or None.
        supply: [mV].
    """

    def __init__(self, core=None):
        self.core = core or Core(boot_id=1)
        self.position = (0, 0, 0)
        self.stuck = None
        self.force = (0, 0, 0)
        self.supply = 6000
        self.estop = False

    def run(self, now: float):
        outputs = self.core.outputs
        if outputs.powered:
            self.position = outputs.applied
        self.position = self.stuck or self.position
        self.core.run(
            round(1e6 * now),
            Measured(self.position, self.force, (2000,) * 4, self.supply, self.estop),
        )

    @property
    def applied(self):
        """[m], or None without power."""
        outputs = self.core.outputs
        return np.array(outputs.applied) * 1e-5 if outputs.powered else None


class Bench:
    """A session and a board behind two lines on one virtual clock, in one thread.

    Attributes:
        up, down: The lines to and from the board.
        asleep: Whether the board's program stands still.
        reads: Whether the host takes what the board sends.
    """

    def __init__(self, robot=None, board=None, start=10.0, seed=0):
        self.robot = robot or rig_file()
        self.board = board or Board()
        self.session = Session(self.robot, nonce=77)
        self.up, self.down = Line(seed), Line(seed + 1)
        self.now, self.asleep, self.reads = start, False, True

    def say(self, frame: bytes, wait: float = 0.0):
        self.up.put(frame, self.now)
        self.run(wait)

    def run(self, duration: float):
        for _ in range(max(1, round(duration / PASS))):
            self.now += PASS
            self.board.core.receive(self.up.take(self.now))
            if not self.asleep:
                self.board.run(self.now)
            if self.reads:
                self.down.put(self.board.core.transmit(), self.now)
            self.up.put(self.session.receive(self.down.take(self.now), self.now), self.now)

    def connect(self):
        self.say(self.session.hello(), 0.01)
        self.say(self.session.configure(), 0.06)

    def start(self):
        """Connected, configured and armed."""
        self.connect()
        self.arm()
        return self

    def arm(self, number=5):
        self.say(self.session.arm(number), 0.06)
        return self.command(self.session.present_target(), 0.02)

    def command(self, length, wait=0.02):
        seq, frame = self.session.setpoint(np.array(length), self.now)
        self.say(frame, wait)
        return seq


class FullDisk:
    """Path of a new file that takes so many bytes, and no more.

    Attributes:
        content: What it has taken.
    """

    def __init__(self, room):
        self._room, self.content = room, b""

    def open(self, *_, **__):
        return self

    def write(self, data):
        part = data[: self._room - len(self.content)]
        if not part:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.content += part
        return len(part)

    def close(self):
        pass

    def __str__(self):
        return "full.link"


class MemoryTransport:
    """One end of a pair of queues; see `transport.Transport`.

    Attributes:
        closed: How often it was closed.
    """

    def __init__(self, incoming, outgoing):
        self._incoming, self._outgoing = incoming, outgoing
        self.closed = 0

    @classmethod
    def pair(cls):
        """Two ends; what is written to one can be read from the other."""
        one, other = SimpleQueue(), SimpleQueue()
        return cls(one, other), cls(other, one)

    def read(self, timeout):
        self._check_open()
        try:
            return self._incoming.get(timeout=timeout)
        except Empty:
            return b""

    def write(self, data):
        self._check_open()
        self._outgoing.put(data)

    def close(self):
        self.closed += 1

    def _check_open(self):
        if self.closed:
            raise LinkError("this end is closed")


class LiveBoard:
    """A board behind a `MemoryTransport` or another end of a line, in real time; a context manager.

    Attributes:
        transport: The host's end, if it is in memory.
        alive: Cleared for a board that hangs.
    """

    def __init__(self, board=None, end=None):
        self.board = board or Board()
        self.transport, memory = MemoryTransport.pair()
        self._end = end or memory
        self.alive = threading.Event()
        self.alive.set()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()

    def inject(self, data):
        """Bytes that the board does not mean to say."""
        self._end.write(data)

    def _serve(self):
        while not self._over.is_set():
            if not self.alive.wait(PASS):
                continue  # what the host sends waits
            self.board.core.receive(self._end.read(PASS))
            self.board.run(time.monotonic())
            sent = self.board.core.transmit()
            if sent:
                self._end.write(sent)


class Terminal(LiveBoard):
    """A board behind a pseudo-terminal, in real time.

    Attributes:
        port: Path that the host opens; another one after `open`.
        ends: The board's end and the host's, which stays open so that a host may come and go; none
            after `hang_up`.
    """

    def __init__(self, board=None):
        super().__init__(board, end=self)
        self.open()

    def open(self):
        self.ends = master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self.port = os.ttyname(slave)

    def hang_up(self):
        for end in self.ends:
            os.close(end)
        self.ends = ()

    def __exit__(self, *_):
        super().__exit__()
        self.hang_up()

    def read(self, timeout):
        readable, _, _ = select.select(self.ends[:1], [], [], timeout)
        return os.read(self.ends[0], 4096) if readable else b""

    def write(self, data):
        with suppress(BlockingIOError):  # what a host has no room for is lost
            os.write(self.ends[0], data)


class RoughTerminal(Terminal):
    """A board behind a pseudo-terminal that can be unplugged, and behind a line in each direction.

    Attributes:
        to_robot, from_robot: The lines.
        reads: Cleared for a peer that does not take what the host writes.
    """

    def __init__(self, board=None, seed=0):
        super().__init__(board)
        self.to_robot, self.from_robot = Line(seed), Line(seed + 1)
        self.reads, self._plugging = threading.Event(), threading.Lock()
        self.reads.set()

    def unplug(self):
        """Hang up on the host."""
        with self._plugging:
            self.hang_up()

    def plug(self):
        """Open a new port for the host."""
        with self._plugging:
            self.open()

    def read(self, timeout):
        with self._plugging:
            if self.ends:
                super().write(self.from_robot.take(time.monotonic()))
            listening = self.ends and self.reads.is_set()
            arrived = super().read(timeout) if listening else b""
        if not listening:
            time.sleep(timeout)
        self.to_robot.put(arrived, time.monotonic())
        return self.to_robot.take(time.monotonic())

    def write(self, data):
        self.from_robot.put(data, time.monotonic())
