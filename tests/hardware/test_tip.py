"""Sources of the tip's place: a tracker's datagrams, and sensors."""

import json
import socket
import time

import numpy as np
import pytest

from softrobot_env.hardware.errors import LinkError
from softrobot_env.hardware.tip import TIP_SOURCES, SensorTip, UdpTip, make_tip_source, sign


@pytest.fixture
def source():
    source = UdpTip(0)
    yield source
    source.close()


def send(source, *datagrams):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for data in datagrams:
            sender.sendto(data, ("127.0.0.1", source.port))


def wait_until(happened):
    end = time.monotonic() + 5.0
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.001)


def test_a_picture_was_taken_before_it_came(source):
    assert source.latest(None, 0.0) is None
    before = time.monotonic()
    send(source, json.dumps({"x": 0.01, "y": -0.02, "age": 0.5, "tag": 7}).encode())
    wait_until(lambda: source.latest(None, 0.0) is not None)
    sight = source.latest(None, 0.0)
    assert sight.position.tolist() == [0.01, -0.02]
    assert before - 0.5 <= sight.time <= time.monotonic() - 0.5


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xff\x00",
        b"[1, 2]",
        b"3",
        b'{"x": 0.1}',
        b'{"x": 0.1, "y": "far"}',
        b'{"x": NaN, "y": 0}',
        b'{"x": 0, "y": Infinity}',
        b'{"x": 0, "y": 0, "age": -1}',
        b'{"x": 0, "y": 0, "age": 1e9}',
        b'{"x": 0, "y": [0]}',
        b'{"x": 0, "y": "0.1"}',
        b'{"x": true, "y": 0}',
        b'{"x": 0, "y": 1e30}',
        b'{"x": 0, "y": 0, "age": true}',
        b'{"x": 0, "y": 1' + b"0" * 400 + b"}",
    ],
)
def test_datagrams_that_say_nothing_are_counted(source, data):
    send(source, data, b'{"x": 1, "y": 2}')
    wait_until(lambda: source.latest(None, 0.0) is not None)
    assert source.refused == 1
    assert source.latest(None, 0.0).position.tolist() == [1.0, 2.0]


def test_the_newest_picture_counts_not_the_last_to_come(source):
    datagrams = [{"x": 1, "y": 0, "age": 0.2}, {"x": 2, "y": 0, "age": 5}, {"x": 3, "y": "end"}]
    send(source, *[json.dumps(each).encode() for each in datagrams])
    wait_until(lambda: source.refused == 1)
    assert source.latest(None, 0.0).position.tolist() == [1.0, 0.0]


def test_what_is_nested_too_deeply_is_no_sight_and_ends_nothing():
    source = UdpTip(0)
    send(source, b"[" * 1400)
    wait_until(lambda: source.refused == 1)
    send(source, b'{"x": 0.1, "y": 0.2}')
    wait_until(lambda: source.latest(None, 0.0) is not None)
    source.close()


def test_with_a_key_only_its_tracker_is_believed_and_nothing_twice():
    source = UdpTip(0, key="secret")
    first = sign({"x": 0.1, "y": 0.2, "count": 5}, "secret")
    bad = [
        b'{"x": 0.3, "y": 0, "count": 9}',
        sign({"x": 0.3, "y": 0, "count": 9}, "guessed"),
        first.replace(b"0.1", b"0.3"),
        sign({"x": 0.3, "y": 0}, "secret"),
        first,
    ]
    send(source, first, *bad)
    wait_until(lambda: source.refused == len(bad))
    assert source.latest(None, 0.0).position.tolist() == [0.1, 0.2]
    send(source, sign({"x": 0.4, "y": 0, "count": time.time_ns()}, "secret"))
    wait_until(lambda: source.latest(None, 0.0).position.tolist() == [0.4, 0.0])
    source.close()
    with pytest.raises(ValueError, match="key must be None or a text that is not empty"):
        UdpTip(0, key="")


def test_closing_frees_the_port_and_is_harmless_twice():
    source = UdpTip(0)
    port = source.port
    source.close()
    source.close()
    again = UdpTip(port)
    with pytest.raises(OSError):
        UdpTip(port)
    again.close()


def test_sensors_are_a_linear_map():
    source = SensorTip([0.01, 0.02], [[1e-3, 0, -1e-3], [0, 2e-3, 0]])
    assert source.latest(None, 1.0) is None
    sight = source.latest((5, 1, 2, 99), 7.0)
    assert sight.time == 7.0
    assert sight.position == pytest.approx([0.013, 0.022])


def test_bad_sources_are_refused():
    known = "udp, sensors, natnet, tags"
    with pytest.raises(ValueError, match=rf"unknown tip source 'radar'; choose from {known}"):
        make_tip_source("radar", {})
    with pytest.raises(ValueError, match="tip source 'udp'"):
        make_tip_source("udp", {"baud": 9600})
    for port in (70000, -1, 4.5, True):
        with pytest.raises(ValueError, match="port must be a whole number from 0 to 65535"):
            make_tip_source("udp", {"port": port})
    with pytest.raises(ValueError, match=r"offset \(2,\)"):
        SensorTip(np.zeros(3), np.zeros((2, 4)))
    assert set(TIP_SOURCES) == {"udp", "sensors", "natnet", "tags"}
    with pytest.raises(ValueError, match="axes must be None or one of"):
        UdpTip(0, axes="xyw")


def test_a_tracker_may_send_three_coordinates_and_an_orientation():
    source = UdpTip(0, axes="xyz")
    half = 2**-0.5
    place = {"x": 0.1, "y": 0.2, "z": 0.3}
    bad = [{"x": 0.1, "y": 0.2}, place | {"q": [1, 1, 0, 0]}, place | {"q": [1]}, place | {"q": 1}]
    send(source, *[json.dumps(each).encode() for each in bad])
    send(source, json.dumps(place | {"q": [half, 0, -half, 0]}).encode())
    wait_until(lambda: source.latest(None, 0.0) is not None)
    assert source.refused == len(bad)
    assert source.latest(None, 0.0).position.tolist() == [0.1, 0.2, 0.3]
    assert source.latest(None, 0.0).orientation == pytest.approx([half, 0, -half, 0])
    source.close()


OWN = """
class Still:
    def __init__(self, place):
        self.place = place

    def latest(self, adc, time):
        return time, self.place

    def close(self):
        pass
"""


def test_a_source_of_ones_own_is_one_file(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(OWN)
    source = make_tip_source(f"{path}:Still", {"place": [1.0, 2.0]})
    assert source.latest(None, 3.0) == (3.0, [1.0, 2.0])
    with pytest.raises(ValueError, match=r"the tip source .*NoSuch"):
        make_tip_source(f"{path}:NoSuch", {})
    with pytest.raises(ValueError, match="unexpected keyword"):
        make_tip_source(f"{path}:Still", {"speed": 1})


def test_a_source_whose_thread_ends_says_so():
    source = UdpTip(0)
    source._read = lambda data, now: {}[0] if data == b"bad" else 1 / 0
    send(source, b"bad", b"worse")
    wait_until(lambda: source._failure is not None)
    assert source.refused == 1
    with pytest.raises(LinkError, match="the tip source has ended: division by zero"):
        source.latest(None, 0.0)
    source.close()
