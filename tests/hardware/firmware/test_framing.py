"""The framing in C++ against the one in Python: every message, every cut, damaged bytes."""

import ctypes
from itertools import pairwise
from random import Random

import pytest
import support.firmware_bench  # noqa: F401  (skips without a compiler)
from hypothesis import example, given
from hypothesis import strategies as st
from support.firmware_bench import CONFIG, Bench, N, running, states

from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import LONGEST, Decoder, Hello, Ping, encode
from softrobot_env.hardware.virtual_robot import Measured, library

#: Range of each field, by its struct code.
RANGES = {
    "B": (0, 2**8 - 1),
    "H": (0, 2**16 - 1),
    "I": (0, 2**32 - 1),
    "h": (-(2**15), 2**15 - 1),
    "i": (-(2**31), 2**31 - 1),
}


class CppDecoder:
    """The same face as `framing.Decoder`, but with bodies as they are."""

    def __init__(self):
        self.library = library()
        self.library.softrobot_decoder_create.restype = ctypes.c_void_p
        self.handle = ctypes.c_void_p(self.library.softrobot_decoder_create())

    def feed(self, data):
        body, found = ctypes.create_string_buffer(LONGEST), []
        for byte in data:
            size = self.library.softrobot_decoder_feed(self.handle, ctypes.c_uint8(byte), body)
            if size & 0xFF:
                found.append(body.raw[: size & 0xFF])
        return found

    @property
    def crc_errors(self):
        return self.library.softrobot_decoder_crc_errors(self.handle) & 0xFFFF

    @property
    def frame_errors(self):
        return self.library.softrobot_decoder_frame_errors(self.handle) & 0xFFFF

    def close(self):
        self.library.softrobot_decoder_destroy(self.handle)


def cpp_frame(body):
    frame = ctypes.create_string_buffer(2 * LONGEST)
    size = library().softrobot_encode(body, len(body), frame)
    return frame.raw[: size & 0xFFFF]


def decode_both(data, cuts=()):
    """(bodies, crc errors, frame errors) of C++ and of Python, of a stream cut into pieces."""
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    pieces = [data[a:b] for a, b in pairwise(edges)]
    cpp, python = CppDecoder(), Decoder()
    bodies = [body for piece in pieces for body in cpp.feed(piece)]
    messages = [found for piece in pieces for found in python.feed(piece)]
    mine = bodies, cpp.crc_errors, cpp.frame_errors
    cpp.close()
    return mine, (
        [m.pack(message, seq) for message, seq in messages],
        python.crc_errors,
        python.frame_errors,
    )


@st.composite
def messages(draw, numbers=tuple(m.TYPES)):
    kind = m.TYPES[draw(st.sampled_from(numbers))]
    n, values = draw(st.integers(1, m.MOST_TENDONS)), {}
    for field in kind.layout:
        number = st.integers(*RANGES[field.code]) | st.just(0)
        single = field.count == 1
        values[field.name] = draw(number if single else st.tuples(*[number] * field.size(n)))
    if "n" in values:
        values["n"] = n
    return kind(**values)


seqs = st.integers(0, 2**16 - 1)
frames = st.builds(encode, messages(), seqs)
cut_places = st.lists(st.integers(0, 10**6), max_size=8)


@given(st.lists(st.tuples(messages(), seqs), min_size=1, max_size=4), cut_places)
def test_whole_messages_of_every_type_arrive(sent, cuts):
    stream = b"".join(encode(message, seq) for message, seq in sent)
    cpp, python = decode_both(stream, cuts)
    assert cpp == python == ([m.pack(message, seq) for message, seq in sent], 0, 0)


@given(messages(tuple(number for number in m.TYPES if number > 64)), seqs)
def test_frames_of_the_device_are_those_of_python(message, seq):
    assert cpp_frame(m.pack(message, seq)) == encode(message, seq)


@st.composite
def flipped(draw):
    """Frames of which bits are flipped."""
    stream = bytearray(b"".join(draw(st.lists(frames, min_size=1, max_size=3))))
    for bit in draw(st.lists(st.integers(0, 8 * len(stream) - 1), min_size=1, max_size=6)):
        stream[bit // 8] ^= 1 << bit % 8
    return bytes(stream)


anything = st.binary(max_size=600) | st.lists(st.sampled_from([0, 1, 2, 3, 254, 255])).map(bytes)


@given(st.lists(frames | flipped() | anything, max_size=3).map(b"".join), cut_places)
def test_flipped_bits_and_garbage_give_the_same_messages_and_errors(stream, cuts):
    cpp, python = decode_both(stream, cuts)
    assert cpp == python


@given(messages(), st.data())
def test_a_cut_frame_does_not_take_the_next_with_it(message, data):
    frame = encode(message, 1)
    kept = frame[: data.draw(st.integers(0, len(frame) - 1))]
    whole = encode(m.Setpoint(1, 2, 3, 0, 3, (4, 5, 6)), 8)
    cpp, python = decode_both(kept + whole)
    assert cpp == python
    assert cpp[0][-1:] == [m.pack(m.Setpoint(1, 2, 3, 0, 3, (4, 5, 6)), 8)]


numbers = st.sampled_from([*m.TYPES]) | st.integers(0, 255)
protocols = st.just(m.PROTOCOL) | st.integers(0, 255)


@given(protocols, numbers, st.integers(0, 70), st.randoms())
@example(m.PROTOCOL - 1, m.Hello.number, 8, Random(0))
def test_right_checksums_around_wrong_bodies_give_the_same_errors(protocol, number, size, random):
    cpp, python = decode_both(cpp_frame(bytes([protocol, number]) + random.randbytes(size)))
    # A hello may be of another protocol, which `pack` does not repeat.
    assert [body[1:] for body in cpp[0]] == [body[1:] for body in python[0]]
    assert cpp[1:] == python[1:]
    assert cpp[1] == 0


@pytest.mark.parametrize("size", [LONGEST - 1, LONGEST, LONGEST + 1, 10 * LONGEST, 70_000])
def test_long_frames_are_dropped(size):
    cpp, python = decode_both(b"\1" * size + encode(m.Setpoint(1, 2, 3, 0, 1, (4,)), 8))
    assert cpp == python
    assert len(cpp[0]) == 1
    assert cpp[1:] == ((1, 0) if size <= LONGEST else (0, 1))


def test_counters_saturate():
    cpp = CppDecoder()
    cpp.feed(b"\2\0" * 70_000)
    assert cpp.frame_errors == 2**16 - 1
    cpp.close()


# ---------------------------------------------------------------- floods
def test_one_flipped_bit_never_gives_another_motion():
    size = len(encode(Bench().setpoint(250, 250, 250), 1))
    for bit in range(8 * size):
        bench = running()
        frame = bytearray(encode(bench.setpoint(250, 250, 250), bench.seq + 1))
        frame[bit // 8] ^= 1 << bit % 8
        bench.core.receive(bytes(frame))
        bench.run()
        bench.run()
        only_a_delimiter = bit // 8 == 0 and bench.out.applied == (60,) * N
        assert bench.out.applied == (50,) * N or only_a_delimiter


QUIET = Measured((0,) * N, (0,) * N, (0,) * 4, 0, False)


def test_states_leave_room_for_answers():
    """To a peer that has read nothing for five seconds."""
    bench = Bench()
    for _ in range(100):
        bench.now += 50_000
        bench.core.run(bench.now, QUIET)
    answers = bench.run(Hello(42, 1, 1), CONFIG, Ping(9))
    hello, config, pong = (message for message in answers if not states([message]))
    assert hello.nonce == 42 and type(config) is m.ConfigAck and type(pong) is m.Pong
