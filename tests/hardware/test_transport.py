"""Serial ports, as pseudo-terminals."""

import os
import tty
from itertools import count

import pytest

from softrobot_env.hardware import transport
from softrobot_env.hardware.errors import LinkError
from softrobot_env.hardware.transport import SerialTransport


@pytest.fixture
def terminal():
    """Both ends of a pseudo-terminal: a file descriptor and a path."""
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for end in (master, slave):
        os.close(end)


def test_bytes_go_both_ways_over_a_serial_port(terminal):
    master, path = terminal
    port = SerialTransport(path, 500000)
    assert port.read(0.01) == b""
    port.write(b"to robot")
    assert os.read(master, 100) == b"to robot"
    os.write(master, b"from robot")
    assert port.read(1.0) == b"from robot"
    port.close()
    port.close()


def test_a_port_is_for_one_program(terminal):
    port = SerialTransport(terminal[1], 500000)
    with pytest.raises(LinkError, match=f"cannot open {terminal[1]}: another program drives"):
        SerialTransport(terminal[1], 500000)
    port.close()


def test_a_process_that_slept_while_it_wrote_has_written(terminal, monkeypatch):
    """Its time is over before it looks whether there is room."""
    master, path = terminal
    port, times = SerialTransport(path, 500000), count(0.0, 10.0)
    with monkeypatch.context() as busy:
        busy.setattr(transport, "monotonic", lambda: next(times))
        port.write(b"to robot")
    assert os.read(master, 100) == b"to robot"
    port.close()


def test_a_write_that_nobody_reads_times_out(terminal):
    port = SerialTransport(terminal[1], 500000)
    with pytest.raises(LinkError, match="cannot write to"):
        port.write(bytes(1 << 20))
    port.close()


def test_a_port_that_is_not_there_is_told():
    with pytest.raises(LinkError, match="cannot open /dev/no-robot"):
        SerialTransport("/dev/no-robot", 500000)


def test_a_hang_up_is_told():
    master, slave = os.openpty()
    tty.setraw(slave)
    port = SerialTransport(os.ttyname(slave), 500000)
    os.close(slave)
    os.close(master)
    with pytest.raises(LinkError, match="has gone"):
        port.read(0.5)
    port.close()
