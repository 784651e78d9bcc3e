"""Frames on the wire: `00 | COBS(body | CRC-32) | 00`.

The leading zero keeps a truncated frame from taking the next one with it. CRC-32 and not 16: after
COBS, one flipped bit on the wire becomes several.
"""

from struct import Struct
from zlib import crc32

from softrobot_env.hardware.protocol.messages import Message, MessageError, pack, seed, unpack

#: Longest frame between its zeros [bytes]; longer ones are dropped as they arrive.
LONGEST = 160

_CRC = Struct("<I")
_TYPE = 1  # index of the message type in a body


def encode(message: Message, seq: int) -> bytes:
    """Frame of a message.

    Raises:
        MessageError: A value does not fit into the message.
    """
    from cobs import cobs

    body = pack(message, seq)
    return b"\0" + cobs.encode(body + _CRC.pack(crc32(body, seed(message.number)))) + b"\0"


class Decoder:
    """Messages out of a stream of bytes, however it is cut into pieces.

    Attributes:
        crc_errors: Frames with a wrong checksum so far.
        frame_errors: Frames that were no COBS, too long, too short, or no known message.
    """

    def __init__(self) -> None:
        self.crc_errors = self.frame_errors = 0
        self._buffer = bytearray()
        self._overlong = False

    def feed(self, data: bytes) -> list[tuple[Message, int]]:
        """Messages, each with its sequence number, that these bytes complete."""
        found = []
        first, *others = data.split(b"\0")
        self._append(first)
        for part in others:
            message = self._end()
            if message is not None:
                found.append(message)
            self._append(part)
        return found

    def _append(self, part: bytes) -> None:
        self._overlong = self._overlong or len(self._buffer) + len(part) > LONGEST
        if self._overlong:
            self._buffer.clear()
        else:
            self._buffer += part

    def _end(self) -> tuple[Message, int] | None:
        """What stands between two zeros; None where there is nothing, or nothing valid."""
        from cobs import cobs

        frame, overlong = bytes(self._buffer), self._overlong
        self._buffer.clear()
        self._overlong = False
        if not (frame or overlong):
            return None
        try:
            data = b"" if overlong else cobs.decode(frame)
            body, checksum = data[: -_CRC.size], data[-_CRC.size :]
            if len(body) > _TYPE and checksum != _CRC.pack(crc32(body, seed(body[_TYPE]))):
                self.crc_errors += 1
                return None
            return unpack(body)
        except (cobs.DecodeError, MessageError):
            self.frame_errors += 1
            return None
