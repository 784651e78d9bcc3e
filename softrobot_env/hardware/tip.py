"""Where the tip is: a tracker's datagrams, tracked bodies, or sensors of the robot.

`TIP_SOURCES` has the kinds by name; `natnet` and `tags` are those of tracked bodies. A source of
your own is a class with the methods of `TipSource`, which a robot file names as `file.py:Name`.
"""

import hmac
import json
import socket
from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from math import inf
from threading import Thread
from time import monotonic
from typing import Annotated, Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy import ndarray

from softrobot_env.core.records import Vector3, check_argument, whole_numbers
from softrobot_env.core.registry import Registry, is_path, load, load_given

from .errors import LinkError

#: Most bytes of a tracker's datagram.
_DATAGRAM = 512

#: Largest number of a port.
LAST_PORT = 65535

Port = Annotated[int, whole_numbers(0, LAST_PORT)]

#: Coordinates of the tip that a source measures.
Axes = Literal["xy", "xz", "yz", "xyz"]

#: Where something is and how it is turned: `[x, y, z]` [m], or `[x, y, z, a, b, c]` with the
#: rotation vector (a, b, c) [rad] from its own axes to those it is given in.
Pose = Vector3 | tuple[float, float, float, float, float, float]

_OLDEST = 10.0  # s, an age beyond it is a mistake
_FARTHEST = 10.0  # m, a place beyond it as well
_UNIT = 1e-2  # that the length of a quaternion may differ from 1

#: [s], in which a closed source's thread ends.
POLL = 0.1


class TipMeasurement(NamedTuple):
    """A measurement of the tip.

    Attributes:
        time: [s] on the host's clock, when it was taken.
        position: (2,) [m], or as many coordinates as the source's `axes` name.
        orientation: (4,) quaternion of the tip's frame in the robot's, real part first; None where
            the source measures none.
    """

    time: float
    position: ndarray
    orientation: ndarray | None = None


class TipSource(Protocol):
    """Measures where the output point is.

    A source may count in `refused` what came and said nothing; `info["tip_refused"]` shows it.
    """

    def latest(self, adc: tuple[int, ...] | None, time: float) -> TipMeasurement | None:
        """The newest measurement, None before the first.

        Args:
            adc: Newest values of the robot's converter, None before the first.
            time: [s], when they were taken on the host's clock.

        Raises:
            LinkError: The source has ended.
        """

    def close(self) -> None:
        """Free what it holds; twice is harmless."""


#: How what comes fails that says nothing of the tip.
_NO_SIGHT = (AttributeError, KeyError, OverflowError, RecursionError, TypeError, ValueError)


class PolledTip:
    """A source with a thread of its own, which waits for measurements.

    The newest counts, not the one that came last. What says nothing is counted in `refused`. A
    subclass has `_next`, and may have `_free`; it starts the thread when it is ready.
    """

    def __init__(self) -> None:
        self.refused = 0
        self._sight: TipMeasurement | None = None
        self._failure: Exception | None = None
        self._closed = False
        self._thread = Thread(target=self._listen, name="tip", daemon=True)

    def latest(self, adc: tuple[int, ...] | None, time: float) -> TipMeasurement | None:
        """See `TipSource`."""
        if self._failure is not None:
            raise LinkError(f"the tip source has ended: {self._failure}")
        return self._sight

    def close(self) -> None:
        """Stop listening."""
        self._closed = True
        if self._thread.is_alive():
            self._thread.join()
        self._free()

    def _listen(self) -> None:
        while not self._closed:
            try:
                sight = self._next()
            except TimeoutError:
                continue
            except _NO_SIGHT:
                self.refused += 1
                continue
            except Exception as error:  # raised by `latest`, where somebody hears it
                self._failure = error
                return
            if sight is not None and (self._sight is None or sight.time > self._sight.time):
                self._sight = sight

    def _next(self) -> TipMeasurement | None:
        """Wait for what comes next, and return the measurement, if it is one.

        Raises:
            TimeoutError: Nothing came in `POLL`.
            ValueError, and others of `_NO_SIGHT`: It says nothing of the tip.
            Exception: Nothing will come any more.
        """
        raise NotImplementedError

    def _free(self) -> None:
        """Free what the source holds; twice is harmless."""


class UdpTip(PolledTip):
    """A tracker that sends a datagram for each picture, as JSON: `{"x": m, "y": m, "age": s}`.

    `age` is how long ago the picture was taken when the datagram is sent, 0 unless given; `q` may
    be the orientation, see `TipMeasurement`. Other keys are ignored. Datagrams that are not of this
    form, or whose numbers no rig can have, are counted in `refused`.

    Any program of this machine can send to the port. With a `key` only datagrams of a tracker that
    knows it count: see `sign`.
    """

    def __init__(
        self, port: int, host: str = "127.0.0.1", key: str | None = None, axes: Axes | None = None
    ) -> None:
        """Listen at a UDP port, 0 for any free one.

        Args:
            port: Its number.
            host: Address to listen at.
            key: Secret that the tracker knows too; none: every sender is believed.
            axes: Names of the coordinates that count, out of "xyz"; unless given x, y, and z of the
                datagrams that have it.

        Raises:
            ValueError: No number of a port, an empty key, or no axes.
            OSError: The port is taken.
        """
        check_argument("port", port, Port)
        check_argument("key", key, str | None)
        check_argument("axes", axes, Axes | None)
        super().__init__()
        self._key, self._count, self._axes = key, -1, axes
        self._socket = listen(host, port)
        self._socket.settimeout(POLL)
        self._thread.start()

    @property
    def port(self) -> int:
        """The UDP port."""
        return self._socket.getsockname()[1]

    def _free(self) -> None:
        self._socket.close()

    def _next(self) -> TipMeasurement:
        return self._read(self._socket.recv(_DATAGRAM), monotonic())

    def _read(self, data: bytes, now: float) -> TipMeasurement:
        """What a datagram says; it fails with one that is none of a tracker."""
        if self._key is not None:
            data = _signed(data, self._key)
        message = json.loads(data)
        axes = self._axes or ("xyz" if "z" in message else "xy")
        place = [_number(message[name], -_FARTHEST, _FARTHEST) for name in axes]
        age = _number(message.get("age", 0.0), 0.0, _OLDEST)
        turn = message.get("q")
        turn = None if turn is None else unit_quaternion([_number(x, -2, 2) for x in turn])
        if self._key is not None:
            self._count = int(_number(message["count"], self._count + 1, inf))
        return TipMeasurement(now - age, np.array(place), turn)


def listen(host: str, port: int, join: tuple[str, str] | None = None) -> socket.socket:
    """A UDP socket at an address.

    Args:
        host: The address.
        port: 0 for any free one.
        join: Address of a multicast group, and of this computer; others may listen at its port too.

    Raises:
        OSError: The port is taken, or there is no such address.
    """
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        if join is not None:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            member = b"".join(map(socket.inet_aton, join))
            found.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        found.bind((host, port))
    except OSError:
        found.close()
        raise
    return found


def sign(message: Mapping[str, float], key: str) -> bytes:
    """A datagram for `UdpTip` with a key: JSON, a space, and HMAC-SHA256 of it in hexadecimal.

    Args:
        message: As of `UdpTip`, with a whole `count` that is larger in each datagram, so that
            an old one cannot be sent again; nanoseconds of the clock serve.
        key: The secret.
    """
    data = json.dumps(dict(message)).encode()
    return data + b" " + _signature(data, key)


def _signature(data: bytes, key: str) -> bytes:
    return hmac.new(key.encode(), data, sha256).hexdigest().encode()


def _signed(data: bytes, key: str) -> bytes:
    """The JSON of a datagram that `sign` made; ValueError for any other."""
    message, _, signature = data.rpartition(b" ")
    if not hmac.compare_digest(signature, _signature(message, key)):
        raise ValueError("not signed by this key")
    return message


def _number(value: object, least: float, most: float) -> float:
    """A number within [least, most]; ValueError for anything else, such as true or a text."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise ValueError(f"no number from {least} to {most}: {value!r}")
    return value


def unit_quaternion(values: Sequence[float]) -> ndarray:
    """A quaternion (4,) of length 1; ValueError for one that no rounding explains."""
    found = np.array(values, float)
    length = np.linalg.norm(found) if found.shape == (4,) else 0.0
    if not abs(length - 1) <= _UNIT:
        raise ValueError(f"no quaternion of length 1: {values}")
    return found / length


class PoseTip(PolledTip):
    """A tracker that sees where bodies are and how they are turned."""

    def __init__(
        self,
        head: Mapping[Any, Pose],
        base: Mapping[Any, Pose] | None = None,
        world: Pose | None = None,
        axes: Axes = "xy",
    ) -> None:
        """Prepare.

        Args:
            head: Tracked body on the robot's head -> its pose in the tip's frame.
            base: Tracked body at the robot's base -> its pose in the robot's frame.
            world: Pose of the tracker's own frame in the robot's, where it tracks no base; the same
                unless given.
            axes: Coordinates that measurements have.

        Raises:
            ValueError: No pose, no head, or both a base and a world.
        """
        super().__init__()
        check_argument("axes", axes, Axes)
        if base and world is not None:
            raise ValueError("give a base that is tracked or a world, not both")
        self._head, self._base = _matrices("head", head), _matrices("base", base or {})
        if not self._head:
            raise ValueError("head names no body")
        self._world = np.eye(4) if world is None else matrix_of("world", world)
        self._columns = ["xyz".index(axis) for axis in axes]

    def _seen(self, time: float, age: float, head: ndarray, base: ndarray | None) -> TipMeasurement:
        """A measurement by what came at a time, and had an age [s] then.

        Args:
            time, age: See there.
            head, base: Poses (4, 4) of tip and robot in the tracker's frame.

        Raises:
            ValueError: No picture is as old, or no robot as large.
        """
        from scipy.spatial.transform import Rotation  # takes time to load

        pose = (self._world if base is None else np.linalg.inv(base)) @ head
        if not np.all(np.abs(pose[:3, 3]) <= _FARTHEST):
            raise ValueError(f"too far: {pose[:3, 3]}")
        turn = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True, scalar_first=True)
        return TipMeasurement(time - _number(age, 0.0, _OLDEST), pose[self._columns, 3], turn)


def _matrices(what: str, poses: Mapping[Any, Pose]) -> dict[str, ndarray]:
    check_argument(what, poses, Mapping)
    return {str(k): matrix_of(f"{what} {str(k)!r}", pose) for k, pose in poses.items()}


def matrix_of(what: str, pose: Pose) -> ndarray:
    """(4, 4) of a pose.

    Raises:
        ValueError: It is none; the message begins with `what`.
    """
    from scipy.spatial.transform import Rotation  # takes time to load

    check_argument(what, pose, Pose)
    matrix = np.eye(4)
    matrix[:3, 3] = pose[:3]
    if len(pose) == 6:
        matrix[:3, :3] = Rotation.from_rotvec(pose[3:]).as_matrix()
    return matrix


class SensorTip:
    """The tip from the robot's own sensors: `offset + matrix @ adc`."""

    def __init__(self, offset: ndarray, matrix: ndarray) -> None:
        """A linear map, offset (2,) [m] and matrix (2, channels) [m]."""
        self._offset, self._matrix = np.array(offset, float), np.array(matrix, float)
        if self._offset.shape != (2,) or self._matrix.ndim != 2 or len(self._matrix) != 2:
            raise ValueError(
                f"sensors need an offset (2,) and a matrix (2, channels), got "
                f"{self._offset.shape} and {self._matrix.shape}"
            )

    def latest(self, adc: tuple[int, ...] | None, time: float) -> TipMeasurement | None:
        """See `TipSource`."""
        if adc is None:
            return None
        values = np.array(adc[: self._matrix.shape[1]], float)
        return TipMeasurement(time, self._offset + self._matrix @ values)

    def close(self) -> None:
        """Nothing to free."""


#: Kind of tip source, as in a robot file, -> its class, or where that is.
TIP_SOURCES: Registry[Callable[..., TipSource] | str] = Registry(
    "tip source",
    {
        "udp": UdpTip,
        "sensors": SensorTip,
        "natnet": "softrobot_env.hardware.natnet:NatNetTip",
        "tags": "softrobot_env.hardware.tags:TagTip",
    },
)


def make_tip_source(kind: str, options: Mapping[str, Any]) -> TipSource:
    """Build a tip source by name, or by the path `package.module:Name` or `file.py:Name`.

    Raises:
        ValueError: Unknown kind, or options it does not have.
        ImportError: A package is missing; the message tells what to install.
        OSError: It cannot be opened.
    """
    make = load_given("tip source", kind) if is_path(kind) else TIP_SOURCES.find(kind)
    make = load(make) if isinstance(make, str) else make
    try:
        return make(**options)
    except TypeError as error:
        raise ValueError(f"tip source {kind!r}: {error}") from None
