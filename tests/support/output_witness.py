"""What a robot may do, stated a second time: a witness that judges every pass of its program."""

from zlib import crc32

from softrobot_env.hardware.protocol import messages as m
from softrobot_env.hardware.protocol.messages import HEADER_SIZE, Decoder
from softrobot_env.hardware.virtual_robot import Core, Measured, Outputs

_CLOCK, _SEQ = 1 << 32, 1 << 16
_MILLION = 10**6
_LONGEST = 50_000  # µs, that a program which was stuck catches up


class Permission:
    """Which set-points of a session count; the rules of the protocol, stated a second time.

    Attributes:
        session: Its number.
        target: Of the last set-point that counted, None before the first.
        fed: When that was [µs].
    """

    def __init__(self, session: int) -> None:
        self.session = session
        self.target: tuple[int, ...] | None = None
        self.fed = 0
        self._seq = 0
        self._least: int | None = None
        self._least_at = 0

    def take(self, setpoint: m.Setpoint, seq: int, now: int, config: m.Config) -> bool:
        """Whether a set-point that arrived at `now` [µs] counts."""
        if setpoint.session != self.session:
            return False
        if self.target is not None and _signed(seq - self._seq, _SEQ) <= 0:
            return False
        if self._age(setpoint.t_host, now) > 1000 * setpoint.ttl_ms:
            return False
        limits = zip(config.minimum, setpoint.target, config.maximum, strict=True)
        if not all(low <= target <= high for low, target, high in limits):
            return False
        self.target, self.fed, self._seq = setpoint.target, now, seq
        return True

    def _age(self, t_host: int, now: int) -> int:
        """[µs] beyond the least delay of the session, which may rise by 1/128 of the time."""
        offset = _signed(now - t_host, _CLOCK)
        if self._least is None:
            self._least = offset
        else:
            risen = self._least + (now - self._least_at) % _CLOCK // 128
            self._least = min(offset, risen)
        self._least_at = now
        return offset - self._least


class Witness:
    """Asserts in every pass of a device that its outputs do what they may.

    Always: outputs are inside limits and slew rates. While a fresh set-point of the session is
    there they go towards it; otherwise they go to rest with the ramp's speed, or stand still.
    Power comes with a set-point near the servos' place only.

    It judges by the messages that reached the device. What the device says of its state can take
    a permission away but never give one.

    Attributes:
        followed: Time [µs] and target of every set-point that counted.
        blind: Whether the device does not measure lengths: servos are where they were last driven.
    """

    def __init__(self, blind: bool = False) -> None:
        self.blind = blind
        self.followed: list[tuple[int, tuple[int, ...]]] = []
        self._known: dict[int, m.Config] = {}  # those that arrived, by their checksum
        self._config: m.Config | None = None
        self._permission: Permission | None = None
        self._now = 0
        self._carry = [0] * m.MOST_TENDONS  # millionths of a unit that a slow output may make up

    def judge(
        self,
        now: int,
        measured: Measured,
        before: Outputs,
        after: Outputs,
        arrived: list[tuple[m.Message, int]],
    ) -> None:
        """Outputs `before` and `after` a pass at `now` [µs], and (message, number) in it."""
        elapsed, self._now = (now - self._now) % _CLOCK, now
        self._expire()
        self._check_limits(after)
        driven = before.powered and after.powered
        if driven:
            self._check_motion(before.applied, after.applied, elapsed)
        present = before.applied if self.blind else measured.length
        first = self._follow(arrived, None if before.powered else present, driven)
        if after.powered and not before.powered:
            assert first, "power without a set-point"
            assert after.applied == self._inside(present)
        if after.state not in (m.DeviceState.ARMED, m.DeviceState.RUNNING):
            self._permission = None

    def _expire(self) -> None:
        permission = self._permission
        if permission is None or permission.target is None:
            return
        if (self._now - permission.fed) % _CLOCK >= 1000 * self._config.watchdog_ms:
            self._permission = None

    def _check_limits(self, out) -> None:
        if not out.powered:
            assert not any(out.pulse_us), f"pulses without power: {out}"
            return
        assert out.applied == self._inside(out.applied), f"outside the limits: {out}"
        config = self._config
        for length, pulse, center, gain in zip(
            out.applied, out.pulse_us, config.center_us, config.gain, strict=True
        ):
            assert abs(center + gain * length / 1e4 - pulse) <= 0.51, f"wrong pulses: {out}"

    def _check_motion(self, before, after, elapsed: int) -> None:
        config, permission = self._config, self._permission
        follows = permission is not None and permission.target is not None
        goal = permission.target if follows else config.rest
        for i, (start, end) in enumerate(zip(before, after, strict=True)):
            way, moved = goal[i] - start, end - start
            assert min(0, way) <= moved <= max(0, way), f"tendon {i} went {moved} of {way}"
            speed = config.slew[i] if follows else min(config.ramp, config.slew[i])
            left = self._carry[i] + speed * min(elapsed, _LONGEST) - _MILLION * abs(moved)
            assert left >= 0, f"tendon {i} went {moved} in {elapsed} µs"
            self._carry[i] = min(left, _MILLION)

    def _follow(self, arrived, present, driven: bool) -> bool:
        """Take in messages; whether one of them may switch the power on.

        Args:
            arrived: Messages and their numbers.
            present: Where the servos are, near which a set-point must be; None with power.
            driven: Whether there was power all the time, so that nothing can be armed.
        """
        first = False
        for message, seq in arrived:
            match message:
                case m.Config():
                    self._known[crc32(m.pack(message, 0)[HEADER_SIZE:])] = message
                case m.Arm() if not driven and message.config_crc in self._known:
                    self._permission = self._permission or Permission(message.session)
                    self._config = self._known[message.config_crc]
                case m.Hello() | m.EStop():
                    self._permission = None
                case m.Stop() | m.Disarm() if self._is_ours(message):
                    self._permission = None
                case m.Setpoint() if self._is_ours(message):
                    if present is None or self._is_near(message, present):
                        first |= self._allow(message, seq)
        return first

    def _is_ours(self, message) -> bool:
        return self._permission is not None and self._permission.session == message.session

    def _allow(self, setpoint: m.Setpoint, seq: int) -> bool:
        counts = self._permission.take(setpoint, seq, self._now, self._config)
        if counts:
            self.followed.append((self._now, setpoint.target))
        return counts

    def _is_near(self, setpoint: m.Setpoint, present) -> bool:
        pairs = zip(setpoint.target, present, strict=True)
        return all(abs(a - b) <= self._config.arm_window for a, b in pairs)

    def _inside(self, length) -> tuple[int, ...]:
        limits = zip(self._config.minimum, length, self._config.maximum, strict=True)
        return tuple(min(max(low, value), high) for low, value, high in limits)


def _signed(difference: int, wrap: int) -> int:
    return (difference + wrap // 2) % wrap - wrap // 2


class WatchedCore(Core):
    """A device with a witness.

    Attributes:
        witness: It.
        heard: Every message that reached the device intact.
        adc: Counts of its converter; as the board measures if None.
    """

    def __init__(self, **options) -> None:
        super().__init__(**options)
        blind = not options.get("capabilities", m.Capability.LENGTH) & m.Capability.LENGTH
        self.witness = Witness(blind)
        self.heard: list[m.Message] = []
        self.adc: tuple[int, int, int, int] | None = None
        self._decoder, self._arrived = Decoder(), []
        self._before = self.outputs

    def receive(self, data: bytes) -> None:
        """See `Core`."""
        super().receive(data)
        arrived = self._decoder.feed(data)
        self._arrived += arrived
        self.heard += (message for message, _ in arrived)

    def run(self, now_us: int, measured: Measured) -> None:
        """See `Core`."""
        if self.adc is not None:
            measured = measured._replace(adc=self.adc)
        super().run(now_us, measured)
        before, self._before = self._before, self.outputs
        arrived, self._arrived = self._arrived, []
        self.witness.judge(now_us % _CLOCK, measured, before, self._before, arrived)
