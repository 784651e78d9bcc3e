"""Where the tip is: a tracker's datagrams, or sensors of the robot."""

import json
import socket
from collections.abc import Callable, Mapping
from math import isfinite
from threading import Thread
from time import monotonic
from typing import Any, NamedTuple, Protocol

import numpy as np

from softrobot_env.hardware.robot_file.keys import check_whole
from softrobot_env.registries import Registry

#: Most bytes of a tracker's datagram.
_DATAGRAM = 512

_LAST_PORT = 65535

_OLDEST = 10.0  # s, an age beyond it is a mistake
_POLL = 0.1  # s, in which a closed source's thread ends


class Sight(NamedTuple):
    """A measurement of the tip: when it was taken [s], on the host's clock, and (2,) [m]."""

    time: float
    position: np.ndarray


class TipSource(Protocol):
    """Measures x and y of the output point."""

    def latest(self, adc: tuple[int, ...] | None, time: float) -> Sight | None:
        """The newest measurement, None before the first.

        Args:
            adc: Newest values of the robot's converter, None before the first.
            time: [s], when they were taken on the host's clock.
        """

    def close(self) -> None:
        """Free what it holds; twice is harmless."""


class UdpTip:
    """A tracker that sends a datagram for each picture, as JSON: `{"x": m, "y": m, "age": s}`.

    `age` is how long ago the picture was taken when the datagram is sent, 0 unless given. Other
    keys are ignored; datagrams that are not of this form are counted in `refused`.
    """

    def __init__(self, port: int, host: str = "127.0.0.1") -> None:
        """Listen at a UDP port, 0 for any free one.

        Raises:
            ValueError: No number of a port.
            OSError: The port is taken.
        """
        check_whole("port", port, _LAST_PORT)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError:
            self._socket.close()
            raise
        self._socket.settimeout(_POLL)
        self.refused = 0
        self._sight: Sight | None = None
        self._closed = False
        self._thread = Thread(target=self._listen, name="tip", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The UDP port."""
        return self._socket.getsockname()[1]

    def latest(self, adc: tuple[int, ...] | None, time: float) -> Sight | None:
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
            sight = _read(data, monotonic())
            if sight is None:
                self.refused += 1
            else:
                self._sight = sight


def _read(data: bytes, now: float) -> Sight | None:
    """What a datagram says; None if it is none of a tracker."""
    try:
        message = json.loads(data)
        x, y, age = float(message["x"]), float(message["y"]), float(message.get("age", 0.0))
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError):
        return None
    if not (isfinite(x) and isfinite(y) and 0 <= age < _OLDEST):
        return None
    return Sight(now - age, np.array([x, y]))


class SensorTip:
    """The tip from the robot's own sensors: `offset + matrix @ adc`."""

    def __init__(self, offset: np.ndarray, matrix: np.ndarray) -> None:
        """A linear map, offset (2,) [m] and matrix (2, channels) [m]."""
        self._offset, self._matrix = np.array(offset, float), np.array(matrix, float)
        if self._offset.shape != (2,) or self._matrix.ndim != 2 or len(self._matrix) != 2:
            raise ValueError(
                f"sensors need an offset (2,) and a matrix (2, channels), got "
                f"{self._offset.shape} and {self._matrix.shape}"
            )

    def latest(self, adc: tuple[int, ...] | None, time: float) -> Sight | None:
        """See `TipSource`."""
        if adc is None:
            return None
        values = np.array(adc[: self._matrix.shape[1]], float)
        return Sight(time, self._offset + self._matrix @ values)

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
