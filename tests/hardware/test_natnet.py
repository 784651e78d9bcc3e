"""Frames of NatNet against packets that were put together from its public description."""

import gc
import random
import socket
import time
from contextlib import closing, contextmanager

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softrobot_env.hardware.errors import LinkError
from softrobot_env.hardware.natnet import NatNetTip, Server, frame_of, message, names_of, server_of
from softrobot_env.hardware.tip import make_tip_source
from studies.truths.natnet_packets import (
    FREQUENCY,
    Motive,
    descriptions,
    frame,
    packet,
    server_info,
)

VERSIONS = [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]

TURN = Rotation.from_rotvec([0.3, -0.5, 0.9])
BODY = (12, (0.25, -0.125, 1.5), tuple(TURN.as_quat().tolist()), True)
LOST = (13, (float("nan"),) * 3, (0.0,) * 4, False)


def content(data):
    return message(data)[1]


@contextmanager
def connected(version, names=None, **options):
    """A server, and a source that knows it."""
    options = {"head": {12: [0, 0, 0]}, **options}
    with closing(Motive(version, names or {})) as server:
        tip = NatNetTip(multicast="", host="127.0.0.1", port=server.port, **options)
        with closing(tip):
            wait_until(lambda: tip.ready or tip._failure is not None)
            yield server, tip


def wait_until(happened):
    end = time.monotonic() + 5.0
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.001)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("full", [False, True])
def test_a_frame_is_read_whatever_else_is_in_it(version, full):
    server = server_of(content(server_info(version)))
    assert server == Server(version, FREQUENCY)
    found = frame_of(content(frame(version, 5, [LOST, BODY], 1000, 51000, full, True)), server)
    assert (found.number, found.age, found.changed) == (5, pytest.approx(0.005), True)
    assert list(found.bodies) == [13, 12]
    assert found.bodies[12][1:8] == pytest.approx(BODY[1] + BODY[2], abs=1e-7)
    assert [numbers[-1] & 1 for numbers in found.bodies.values()] == [0, 1]


@pytest.mark.parametrize("version", VERSIONS)
def test_names_are_found_among_all_kinds_of_descriptions(version):
    found = names_of(content(descriptions(version, {"tip": 12, "base": 3})), version)
    assert found == {"tip": 12, "base": 3}


@pytest.mark.parametrize("version", VERSIONS)
def test_packets_that_are_cut_short_anywhere_are_refused(version):
    server = Server(version, FREQUENCY)
    whole = content(frame(version, 5, [BODY], 1000, 51000))
    for size in range(len(whole) - 4):  # without the tag at the end it is complete
        with pytest.raises(ValueError):
            frame_of(whole[:size], server)
    named = content(descriptions(version, {"tip": 12}))
    for size in range(len(named)):
        with pytest.raises((ValueError, KeyError)):
            names_of(named[:size], version)
    for size in range(4, len(whole)):
        with pytest.raises(ValueError):
            message(frame(version, 5, [BODY], 1000, 51000)[:size])


@pytest.mark.parametrize("version", [(3, 0), (4, 1)])
def test_the_source_survives_damaged_packets(version):
    """What comes is a measurement by the true numbers, or by damaged ones, or it is refused."""
    rng = random.Random(0)
    with connected(version) as (server, tip):
        whole = frame(version, 2, [BODY], 1000, 51000)
        for _ in range(2000):
            data = bytearray(whole)
            for _ in range(rng.randint(1, 8)):
                data[rng.randrange(len(data))] = rng.randrange(256)
            if data[0] not in (1, 5):  # what a server says of itself is believed
                server.send(bytes(data[: rng.randint(0, len(data))]))
        server.send(packet(9, b"end"))  # of no meaning, and harmless
        server.names = {"end": 1}
        while "end" not in tip._names:  # what is too much for the socket is lost
            server.send(descriptions(version, server.names))
            time.sleep(0.05)
        assert tip.refused > 100 and tip._failure is None
        tip._came -= 2.0  # a damaged number may have been a large one
        before = tip.latest(None, 0.0)
        server.show([BODY])
        wait_until(lambda: tip.latest(None, 0.0) is not before)
        assert tip.latest(None, 0.0).position == pytest.approx([0.25, -0.125])


@pytest.mark.parametrize("version", VERSIONS)
def test_pose_and_time_of_a_body_by_its_name(version):
    """The tip is 2 cm before a body, in the frame of a base that is turned and shifted."""
    base_turn = Rotation.from_rotvec([np.pi / 2, 0, 0])  # Motive's y is up
    base = (3, (0.5, 0.25, -0.75), tuple(base_turn.as_quat().tolist()), True)
    inside = np.array([0.1, 0.2, 0.3])  # of the tip, in the base's frame
    turn = Rotation.from_rotvec([0.0, 0.7, 0.2])
    body_turn = base_turn * turn
    place = np.array(base[1]) + base_turn.apply(inside) - body_turn.apply([0, 0, 0.02])
    body = (12, tuple(place.tolist()), tuple(body_turn.as_quat().tolist()), True)
    options = {"head": {"tip": [0, 0, -0.02]}, "base": {"base": [0, 0, 0]}, "axes": "xyz"}
    with connected(version, {"base": 3, "tip": 12}, **options) as (server, tip):
        before = time.monotonic()
        server.show([LOST, base, body], age=0.25)
        wait_until(lambda: tip.latest(None, 0.0) is not None)
        found = tip.latest(None, 0.0)
        assert before - 0.25 <= found.time <= time.monotonic() - 0.25
        assert found.position == pytest.approx(inside, abs=1e-6)
        wanted = turn.as_quat(canonical=True, scalar_first=True)
        assert found.orientation == pytest.approx(wanted, abs=1e-6)


def test_the_trackers_world_may_lie_anywhere_in_the_robots():
    body = (1, (0.1, 0.2, 0.3), (0.0, 0.0, 0.0, 1.0), True)
    options = {"head": {1: [0, 0, 0]}, "world": [1.0, 0, 0, np.pi / 2, 0, 0], "axes": "xyz"}
    with connected((4, 1), **options) as (server, tip):
        server.show([body])
        wait_until(lambda: tip.latest(None, 0.0) is not None)
        assert tip.latest(None, 0.0).position == pytest.approx([1.1, -0.3, 0.2], abs=1e-6)


def test_nothing_old_counts_as_new():
    moved = (12, (0.5, 0.0, 0.0), BODY[2], True)
    with connected((4, 1)) as (server, tip):
        now = time.monotonic_ns() // 100
        server.send(frame((4, 1), 10, [BODY], now, now))
        wait_until(lambda: tip.latest(None, 0.0) is not None)
        first = tip.latest(None, 0.0)
        server.send(frame((4, 1), 9, [moved], now, now))  # overtaken
        server.send(frame((4, 1), 10, [moved], now, now))  # paused
        server.send(frame((4, 1), 11, [LOST], now, now))
        server.send(frame((4, 1), 12, [(12, *LOST[1:])], now, now))
        server.send(frame((4, 1), 13, [moved], now + 99, now))  # taken after it was sent
        server.send(frame((4, 1), 14, [(12, (99.0, 0.0, 0.0), BODY[2], True)], now, now))
        server.send(
            frame((4, 1), 15, [(12, (0.5, 0.0, 0.0), (0.1, 0.2, 0.3, 0.4), True)], now, now)
        )
        wait_until(lambda: tip.refused == 7)
        assert tip.latest(None, 0.0) is first
        server.send(frame((4, 1), 16, [moved], now, now))
        wait_until(lambda: tip.latest(None, 0.0) is not first)
        tip._came -= 2.0  # nothing for two seconds: Motive has started again
        server.send(frame((4, 1), 1, [BODY], now, now))
        wait_until(lambda: tip.latest(None, 0.0).position[0] == pytest.approx(0.25))


def test_bodies_that_change_are_asked_for_again_and_missed_by_name():
    with connected((4, 2), {"tip": 12}, head={"tip": [0, 0, 0]}) as (server, tip):
        server.names = {"other": 12, "base": 3}
        server.show([BODY], changed=True)
        wait_until(lambda: tip._failure is not None)
        with pytest.raises(LinkError, match="no rigid body 'tip'; it has other, base"):
            tip.latest(None, 0.0)


def test_other_versions_are_not_understood():
    said = r"NatNet 2\.9 are not understood, 3\.0 to 4\.x are"
    with connected((2, 9)) as (_, tip), pytest.raises(LinkError, match=said):
        tip.latest(None, 0.0)


def test_other_computers_are_not_believed():
    other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with connected((4, 1)) as (_, tip), closing(other):
        other.bind(("127.0.0.2", 0))
        other.sendto(frame((4, 1), 1, [BODY], 1, 1), tip._sockets[0].getsockname())
        wait_until(lambda: tip.refused == 1)
        assert tip.latest(None, 0.0) is None


def test_frames_arrive_by_multicast():
    group = "239.255.42.98"
    with closing(Motive((4, 0), {})) as server:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("", 0))
            port = free.getsockname()[1]
        options = {"multicast": group, "host": "127.0.0.1", "head": {"12": [0, 0, 0]}}
        options |= {"port": server.port, "data_port": port}
        with closing(make_tip_source("natnet", options)) as tip:
            wait_until(lambda: tip._server is not None)
            here = socket.inet_aton("127.0.0.1")
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, here)
                sender.sendto(frame((4, 0), 1, [BODY], 1, 1), (group, port))
            wait_until(lambda: tip.latest(None, 0.0) is not None)
            assert tip.latest(None, 0.0).position == pytest.approx([0.25, -0.125])


@pytest.mark.parametrize(
    "options, allowed",
    [
        ({"head": {}}, "head names no body"),
        ({"head": [1]}, "head must be a Mapping"),
        ({"head": {"a": [1, 2]}}, "head 'a' must be a tuple of 3, each a finite number or"),
        ({"head": {"a": [1, 2, "3"]}}, "head 'a' must be a tuple of 3"),
        ({"base": {"a": [1, 2, float("nan")]}}, "base 'a' must be a tuple of 3"),
        ({"world": [1, 2, 3, 4]}, "world must be a tuple of 3"),
        ({"axes": "xx"}, "axes must be one of"),
        ({"axes": ""}, "axes must be one of"),
        ({"base": {"b": [0, 0, 0]}, "world": [0, 0, 0]}, "not both"),
        ({"port": 70000}, "port must be a whole number from 0 to 65535"),
        ({"data_port": "x"}, "data_port must be a whole number from 0 to 65535"),
        ({"speed": 3}, "natnet"),
    ],
)
def test_bad_options_are_refused(options, allowed):
    with pytest.raises(ValueError, match=allowed):
        make_tip_source("natnet", {"head": {"a": [0, 0, 0]}, **options})


@pytest.mark.parametrize("version", [(3, 0), (4, 1)])
def test_another_client_reads_the_same_of_these_packets(version):
    """The package `natnet` reads whole packets; it judges the packets here, not the decoder."""
    natnet = pytest.importorskip("natnet")
    buffer = natnet.packet_buffer.PacketBuffer(content(frame(version, 5, [BODY], 1000, 51000)))
    found = natnet.data_frame.DataFrame.read_from_buffer(buffer, natnet.version.Version(*version))
    (body,) = found.rigid_bodies
    assert (body.id_num, body.tracking_valid) == (12, True)
    assert body.pos + body.rot == pytest.approx(BODY[1] + BODY[2], abs=1e-7)
    assert found.suffix.stamp_transmit - found.suffix.stamp_camera_mid_exposure == 50000


def test_what_cannot_be_opened_leaves_nothing_open():
    with pytest.raises(OSError):
        NatNetTip(head={1: [0, 0, 0]}, multicast="no group")
    gc.collect()  # a socket that is still open would warn
