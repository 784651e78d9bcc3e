"""Where the tip is: a tracker's datagrams, or sensors of the robot."""

import hmac
import json
import socket
from collections.abc import Callable, Mapping
from hashlib import sha256
from math import inf
from threading import Thread
from time import monotonic
from typing import Annotated, Any, NamedTuple, Protocol

import numpy as np
from numpy import ndarray

from softrobot_env.core.records import check_argument, whole_numbers
from softrobot_env.core.registry import Registry

#: Most bytes of a tracker's datagram.
_DATAGRAM = 512

#: Largest number of a port.
LAST_PORT = 65535

_OLDEST = 10.0  # s, an age beyond it is a mistake
_FARTHEST = 10.0  # m, a place beyond it as well
_POLL = 0.1  # s, in which a closed source's thread ends


class TipMeasurement(NamedTuple):
    """A measurement of the tip: when it was taken [s], on the host's clock, and (2 or 3,) [m]."""

    time: float
    position: ndarray


class TipSource(Protocol):
    """Measures x and y of the output point, and z if it can.

    A source may count in `refused` what came and said nothing; `info["tip_refused"]` shows it.
    """

    def latest(self, adc: tuple[int, ...] | None, time: float) -> TipMeasurement | None:
        """The newest measurement, None before the first.

        Args:
            adc: Newest values of the robot's converter, None before the first.
            time: [s], when they were taken on the host's clock.
        """

    def close(self) -> None:
        """Free what it holds; twice is harmless."""


#: How datagrams fail that are none of a tracker.
_NO_SIGHT = (AttributeError, KeyError, OverflowError, RecursionError, TypeError, ValueError)


class UdpTip:
    """A tracker that sends a datagram for each picture, as JSON: `{"x": m, "y": m, "age": s}`.

    `age` is how long ago the picture was taken when the datagram is sent, 0 unless given. A tracker
    that sees three coordinates sends "z" as well. Other keys are ignored. The newest picture
    counts, not the one that came last. Datagrams that are not of this form, or whose numbers no rig
    can have, are counted in `refused`.

    Any program of this machine can send to the port. With a `key` only datagrams of a tracker that
    knows it count: see `sign`.
    """

    def __init__(self, port: int, host: str = "127.0.0.1", key: str | None = None) -> None:
        """Listen at a UDP port, 0 for any free one.

        Args:
            port: Its number.
            host: Address to listen at.
            key: Secret that the tracker knows too; none: every sender is believed.

        Raises:
            ValueError: No number of a port, or an empty key.
            OSError: The port is taken.
        """
        check_argument("port", port, Annotated[int, whole_numbers(0, LAST_PORT)])
        check_argument("key", key, str | None)
        self._key, self._count = key, -1
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError:
            self._socket.close()
            raise
        self._socket.settimeout(_POLL)
        self.refused = 0
        self._sight: TipMeasurement | None = None
        self._closed = False
        self._thread = Thread(target=self._listen, name="tip", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The UDP port."""
        return self._socket.getsockname()[1]

    def latest(self, adc: tuple[int, ...] | None, time: float) -> TipMeasurement | None:
        """See `TipSource`."""
        return self._sight

    def close(self) -> None:
        """Stop listening."""
        self._closed = True
        self._thread.join()
        self._socket.close()

    def _listen(self) -> None:
        while not self._closed:
            try:
                data = self._socket.recv(_DATAGRAM)
            except TimeoutError:
                continue
            try:
                sight = self._read(data, monotonic())
            except _NO_SIGHT:
                self.refused += 1
                continue
            if self._sight is None or sight.time > self._sight.time:
                self._sight = sight

    def _read(self, data: bytes, now: float) -> TipMeasurement:
        """What a datagram says; it fails with one that is none of a tracker."""
        if self._key is not None:
            data = _signed(data, self._key)
        message = json.loads(data)
        names = "xyz" if "z" in message else "xy"
        place = [_number(message[name], -_FARTHEST, _FARTHEST) for name in names]
        age = _number(message.get("age", 0.0), 0.0, _OLDEST)
        if self._key is not None:
            self._count = int(_number(message["count"], self._count + 1, inf))
        return TipMeasurement(now - age, np.array(place))


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


#: Kind of tip source, as in a robot file, -> its class.
TIP_SOURCES: Registry[Callable[..., TipSource]] = Registry(
    "tip source", {"udp": UdpTip, "sensors": SensorTip}
)


def make_tip_source(kind: str, options: Mapping[str, Any]) -> TipSource:
    """Build a tip source by name.

    Raises:
        ValueError: Unknown kind, or options it does not have.
    """
    make = TIP_SOURCES.find(kind)
    try:
        return make(**options)
    except TypeError as error:
        raise ValueError(f"tip source {kind!r}: {error}") from None
