"""The table of messages that both sides must share."""

from struct import pack
from zlib import crc32

import pytest
from support.hardware_boards import Bench

from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import Decoder, encode
from softrobot_env.hardware.protocol.session import Phase

#: Burnt into every board of protocol 1: it checks and sends frames with this number. Whoever
#: changes a message or the name of a code changes the hash, and those boards fall silent. If that
#: is meant, raise `PROTOCOL` and tell users to flash their boards; do not just edit this line.
FLASHED = 0x7F7DC78A


@pytest.mark.parametrize("kind", [*m.ENUMERATIONS, *m.FLAGS])
def test_every_number_that_stands_for_something_is_in_the_schema(kind):
    (line,) = [x for x in m.schema_text().splitlines() if x.startswith(f"{kind.__name__} ")]
    assert line.split()[1:] == [f"{code.name}={code.value}" for code in kind]


def test_a_board_that_was_flashed_before_passes_the_handshake():
    bench = Bench()
    ack = m.HelloAck(77, 1, 0x0100, 1, 1, FLASHED, 3, 15, 0)
    bench.session.receive(encode(ack, 0), bench.now)
    assert bench.session.phase == Phase.IDENTIFIED


def test_what_a_board_that_was_flashed_before_says_is_understood():
    cobs = pytest.importorskip("cobs.cobs", reason="needs the robot extra")
    body = m.pack(m.Pong(5, 6), 1)
    frame = cobs.encode(body + pack("<I", crc32(body, FLASHED)))
    assert Decoder().feed(b"\0" + frame + b"\0") == [(m.Pong(5, 6), 1)]
    assert encode(m.Pong(5, 6), 1) == b"\0" + frame + b"\0"
