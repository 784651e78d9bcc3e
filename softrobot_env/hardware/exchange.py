"""Asking a robot and waiting for its answers: a session, a transport, a thread that listens."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from secrets import randbits
from threading import Condition, Event, RLock, Thread
from time import monotonic

from softrobot_env.hardware.errors import LinkError, RefusedError, RobotError
from softrobot_env.hardware.protocol.framing import Decoder, encode
from softrobot_env.hardware.protocol.handshake import DeviceInfo, introduced
from softrobot_env.hardware.protocol.messages import PROTOCOL, Hello, HelloAck, Message, Reason
from softrobot_env.hardware.protocol.session import Session
from softrobot_env.hardware.transport import Transport

_RETRY = 0.2  # s, after which a question is asked again
_POLL = 0.05  # s, in which the listening thread notices the end
_JOIN = 1.0  # s

#: Refusals that may be over when the question is asked again: the robot still ramps.
_PASSING = (Reason.STATE, Reason.SESSION)


class Exchange:
    """One end of a link. Every wait is bounded.

    What goes wrong while listening ends the thread and is raised by the next call.
    """

    def __init__(self, transport: Transport, clock: Callable[[], float]) -> None:
        self._transport, self._clock = transport, clock
        # Both locks are reentrant: a signal's handler may close what it has interrupted.
        self._changed, self._writing, self._closing = Condition(), RLock(), Event()
        self._thread: Thread | None = None
        self._session: Session | None = None
        self._error: RobotError | None = None

    def listen(self, session: Session) -> None:
        """Give what arrives to a session from now on."""
        with self._changed:
            self._session, self._error = session, None
        if self._thread is None or not self._thread.is_alive():
            self._thread = Thread(target=self._listen, name="robot", daemon=True)
            self._thread.start()

    def write(self, data: bytes) -> None:
        """Send bytes, whatever has gone wrong before.

        Raises:
            LinkError: They cannot be sent.
        """
        with self._writing:
            self._transport.write(data)

    @contextmanager
    def held(self) -> Iterator[None]:
        """While nothing is taken in.

        Raises:
            RobotError: What went wrong while listening.
        """
        with self._changed:
            self._raise_error()
            yield

    def wait(self, done: Callable[[], bool], end: float) -> bool:
        """Wait until something is so, at the longest until `end` [s]; whether it is.

        Raises:
            RobotError: What went wrong while listening.
        """
        with self._changed:
            left = max(0.0, end - self._clock())
            self._changed.wait_for(lambda: self._error is not None or done(), left)
            self._raise_error()
            return done()

    def ask(
        self, kind: type[Message], make: Callable[[], bytes], done: Callable[[], bool], end: float
    ) -> None:
        """Send a message, again and again, until what it asks for has happened.

        Args:
            kind: Type of the message.
            make: Makes a frame of it.
            done: Whether it has happened.
            end: [s].

        Raises:
            RefusedError: It was refused; at once if asking again is of no use.
            LinkError: It has not happened in time.
            RobotError: What went wrong while listening, or while making the frame.
        """
        session, reason, name = self._session, None, kind.__name__.upper()
        while not self.wait(done, self._clock()):
            if self._clock() >= end:
                if reason is None:
                    raise LinkError(f"the robot has not answered {name} in time")
                raise RefusedError(name, reason)
            with self.held():
                data = make()
            self.write(data)
            retry = min(end, self._clock() + _RETRY)
            self.wait(lambda: done() or session.refusal(kind) is not None, retry)
            reason = session.refusal(kind)
            if reason in _PASSING:
                self.wait(done, retry)
            elif reason is not None and not done():
                raise RefusedError(name, reason)

    def pause(self, end: float) -> None:
        """Wait until `end` [s], or until this is closed."""
        self._closing.wait(max(0.0, end - self._clock()))

    def close(self) -> None:
        """End the thread; twice is harmless."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(_JOIN)

    def _listen(self) -> None:
        try:
            while not self._closing.is_set():
                data = self._transport.read(_POLL)
                if data:
                    self._take(data)
        except RobotError as error:
            self._fail(error)
        except Exception as error:
            self._fail(RobotError(f"cannot understand the robot: {error}"))

    def _fail(self, error: RobotError) -> None:
        with self._changed:
            self._error = error
            self._changed.notify_all()

    def _take(self, data: bytes) -> None:
        with self._changed:
            reply = self._session.receive(data, self._clock())
            self._changed.notify_all()
        if reply:
            self.write(reply)

    def _raise_error(self) -> None:
        if self._error is not None:
            raise self._error


def identify(transport: Transport, timeout: float = 2.0) -> DeviceInfo:
    """Ask who is at the other end; a robot that moves ramps down.

    Raises:
        LinkError: Nobody answers within `timeout` [s].
        ProtocolMismatchError: See `introduced`.
    """
    hello, decoder = Hello(randbits(32), PROTOCOL, PROTOCOL), Decoder()
    end = monotonic() + timeout
    while monotonic() < end:
        transport.write(encode(hello, 0))
        retry = min(end, monotonic() + _RETRY)
        while monotonic() < retry:
            for message, _ in decoder.feed(transport.read(_POLL)):
                if isinstance(message, HelloAck) and message.nonce == hello.nonce:
                    return introduced(message)
    raise LinkError(f"no robot has answered within {timeout:g} s")
