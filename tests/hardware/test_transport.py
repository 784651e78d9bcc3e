"""Serial ports, as pseudo-terminals."""

import struct
from itertools import count

import pytest
from support.hardware_boards import FullDisk, MemoryTransport, Terminal

from softrobot_env.hardware import transport
from softrobot_env.hardware.errors import LinkError
from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import encode
from softrobot_env.hardware.transport import (
    Chunk,
    Direction,
    LinkLog,
    LoggingTransport,
    SerialTransport,
    read_link_log,
)


@pytest.fixture
def terminal():
    found = Terminal()
    yield found
    found.hang_up()


@pytest.fixture
def port(terminal):
    found = SerialTransport(terminal.port, 500000)
    yield found
    found.close()


def test_bytes_go_both_ways_over_a_serial_port(terminal, port):
    assert port.read(0.01) == b""
    port.write(b"to robot")
    assert terminal.read(1.0) == b"to robot"
    terminal.write(b"from robot")
    assert port.read(1.0) == b"from robot"
    port.close()  # and once more at the end


def test_a_port_is_for_one_program(terminal, port):
    with pytest.raises(LinkError, match=f"cannot open {terminal.port}: another program drives"):
        SerialTransport(terminal.port, 500000)


def test_a_process_that_slept_while_it_wrote_has_written(terminal, port, monkeypatch):
    """Its time is over before it looks whether there is room."""
    times = count(0.0, 10.0)
    with monkeypatch.context() as busy:
        busy.setattr(transport, "monotonic", lambda: next(times))
        port.write(b"to robot")
    assert terminal.read(1.0) == b"to robot"


def test_a_write_that_nobody_reads_times_out(port):
    with pytest.raises(LinkError, match="cannot write to"):
        port.write(bytes(1 << 20))


def test_a_hang_up_is_reported(terminal, port):
    terminal.hang_up()
    with pytest.raises(LinkError, match="has gone"):
        port.read(0.5)


# ----------------------------------------------------------------


@pytest.fixture
def ticks():
    """A clock that goes on by a second whenever it is read."""
    times = iter(range(1, 1000))
    return lambda: float(next(times))


@pytest.fixture
def recorded(tmp_path, ticks):
    """Path of a recording of two chunks."""
    near, far = MemoryTransport.pair()
    recorder = LoggingTransport(near, tmp_path / "short.link", ticks)
    recorder.write(encode(m.Ping(7), 1))
    far.write(encode(m.Pong(7, 8), 2))
    assert recorder.read(1.0)
    recorder.close()
    return tmp_path / "short.link"


def test_what_was_recorded_is_read(recorded):
    log = read_link_log(recorded)
    asked = Chunk(1.0, Direction.TO_ROBOT, encode(m.Ping(7), 1))
    answered = Chunk(2.0, Direction.FROM_ROBOT, encode(m.Pong(7, 8), 2))
    assert log == LinkLog((asked, answered), complete=True)
    found = [(c.direction, message, seq) for c, message, seq in log.messages()]
    assert found == [(Direction.TO_ROBOT, m.Ping(7), 1), (Direction.FROM_ROBOT, m.Pong(7, 8), 2)]


@pytest.mark.parametrize("lost", [1, 5, 25])
def test_a_file_that_breaks_off_is_read_as_far_as_it_goes(recorded, lost):
    whole = read_link_log(recorded)
    recorded.write_bytes(recorded.read_bytes()[:-lost])
    assert read_link_log(recorded) == LinkLog(whole.chunks[:1], complete=False)


def test_a_record_is_in_the_file_at_once(tmp_path, ticks):
    recorder = LoggingTransport(MemoryTransport.pair()[0], tmp_path / "a.link", ticks)
    recorder.write(b"abc")
    assert read_link_log(tmp_path / "a.link").chunks[0].data == b"abc"
    recorder.close()


@pytest.mark.parametrize("room", [30, 40])  # no record, or a part of the first one
def test_a_full_disk_ends_the_recording_and_not_the_link(room):
    near, far = MemoryTransport.pair()
    recorder = LoggingTransport(near, FullDisk(room))
    for data in (b"set-point" * 4, b"stop"):
        recorder.write(data)
        assert far.read(0.0) == data
    far.write(b"stopped")
    assert recorder.read(0.0) == b"stopped"
    assert "No space left" in str(recorder.failure)


def test_what_is_sent_stands_before_its_answer(tmp_path):
    """Although an answer may be written first: only its sending comes first."""
    times = iter([1.0, 2.0])
    near, far = MemoryTransport.pair()
    recorder = LoggingTransport(near, tmp_path / "a.link", lambda: next(times))

    def answer_first(data):
        far.write(b"answer")
        recorder.read(0.0)

    near.write = answer_first
    recorder.write(b"question")
    recorder.close()
    directions = [chunk.direction for chunk in read_link_log(tmp_path / "a.link").chunks]
    assert directions == [Direction.TO_ROBOT, Direction.FROM_ROBOT]


def test_a_recording_never_replaces_a_file(recorded):
    with pytest.raises(FileExistsError):
        LoggingTransport(MemoryTransport.pair()[0], recorded)


def test_other_files_are_refused(tmp_path, recorded):
    other = tmp_path / "other"
    other.write_bytes(b"something else")
    with pytest.raises(ValueError, match="is no log"):
        read_link_log(other)
    data = recorded.read_bytes()
    start = data.index(b"\n") + 1
    other.write_bytes(data[:start] + struct.pack("<I", m.SCHEMA ^ 1) + data[start + 4 :])
    with pytest.raises(ValueError, match="another table of messages"):
        read_link_log(other)
