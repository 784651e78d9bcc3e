"""Tip tracking with a real robot; the contract of `TrackingEnv`.

It also contains the environment's view of the robot: its hardware and tip source, the filtered tip
measurements, and the check that it has settled.
"""

import os
import weakref
from collections.abc import Callable
from contextlib import suppress
from math import dist, floor, hypot, inf, nan
from pathlib import Path
from threading import Thread, current_thread, main_thread
from time import monotonic, sleep
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy import ndarray

from softrobot_env.core.interfaces import Seen
from softrobot_env.core.records import check_argument, shown
from softrobot_env.hardware.errors import (
    FaultInfo,
    LinkError,
    RefusedError,
    RobotError,
    RobotFaultError,
)
from softrobot_env.hardware.interface import Hardware, HardwareFile
from softrobot_env.hardware.motor_file import MotorFile
from softrobot_env.hardware.protocol.messages import Fault
from softrobot_env.hardware.registry import (
    find_hardware,
    hardware_of,
    kind_of,
    open_hardware,
    with_port,
)
from softrobot_env.hardware.robot_file import RobotFile, rig_file
from softrobot_env.hardware.tip import TipMeasurement, TipSource, make_tip_source
from softrobot_env.hardware.transport import Transport
from softrobot_env.robots import LENGTH_SCALE, entry_of, usual_task
from softrobot_env.scene.config import DEFAULT_RULE
from softrobot_env.scene.quadrature import place_hinges
from softrobot_env.scene.registry import RIG_PIECES
from softrobot_env.tasks import Task

from .config import REAL, REAL_ROBOT, EnvConfig
from .observations.table import EVERY, OBSERVABLES, Sizes, Sources, each_of, reads, speed_limit
from .options import REAL_OPTIONS, ResetOptions, one_action, parse_options
from .parts import EnvParts, EpisodeSpec, make_env_task, with_room
from .reference import ReferenceTable

#: Observables that need hardware with force measurement.
TENSION = "tendon_tension"

#: Observables of real robots.
_SEEN = tuple(name for name in EVERY if not name.startswith(("curvature", "motor_force", "anchor")))


class StepClock:
    """Due times of steps. Lateness does not accumulate, and missed steps are not repeated."""

    def __init__(self, period: float) -> None:
        """A clock with a period [s]."""
        self._period, self._due = period, 0.0

    def start(self) -> None:
        """The first step is due now."""
        self._due = monotonic()

    def begin(self) -> tuple[float, int]:
        """Begin a step.

        Returns:
            Lateness [s], and the number of whole periods skipped: none if late by less than half a
            period, as the next deadline is still met.
        """
        late = monotonic() - self._due
        missed = floor(late / self._period + 0.5) if late > 0 else 0
        self._due += missed * self._period
        return late, missed

    @property
    def deadline(self) -> float:
        """[s], end of the current step."""
        return self._due + self._period

    def finish(self) -> None:
        """Wait for the end of the step."""
        self._due += self._period
        left = self._due - monotonic()
        if left > 0:
            sleep(left)


class RealParts(EnvParts):
    """A real robot.

    Attributes:
        file: Description of its hardware.
        reach: Box of the reachable tip positions.
        speed: [m/s], limit of the tip's speed.
    """

    def __init__(self, config: EnvConfig) -> None:
        kinds = str | Path | RobotFile | MotorFile | None
        check_argument("robot_file", config.robot_file, kinds)
        task = make_env_task(config)
        if task.robot.drive.kind != "length":
            raise ValueError(
                f"real robots wind their tendons: robot {task.robot.name!r} needs drive = "
                f'"length" in its file, it is driven by {task.robot.drive.kind}'
            )
        if any(task.start_input):
            raise ValueError(
                f"task {task.label!r} does not start with all tendons at length zero; a real robot "
                "begins where its tendons are let out, and nobody drives it before the first step"
            )
        self.file = _choose_file(config, task)
        period, observe = config.control_period, config.observe
        super().__init__(config, task, self.file.control_period if period is None else period)
        _check_period(self.file, self.control_period)
        robot = task.robot
        self.speed = speed_limit(robot)
        layout = place_hinges(robot.length, RIG_PIECES, DEFAULT_RULE)
        sizes = Sizes(robot, layout, robot.pieces, self.speed, 2, self.axes)
        sizes = with_room(sizes, robot, len(config.preview))
        self.reach = OBSERVABLES["tip_position"].space(sizes)
        if observe == "all":
            observe = tuple(name for name in _SEEN if name != TENSION)
        self._make_spaces(observe, _SEEN, sizes)

    def parse_options(self, options: dict[str, Any] | None) -> ResetOptions:
        """See `EnvParts`."""
        return parse_options(options, REAL_OPTIONS)

    def placed(self, sight: TipMeasurement) -> TipMeasurement:
        """A measurement with the coordinates (d,) [m] that the task names.

        Raises:
            StaleError: The tip source measures too few.
        """
        if len(sight.position) == len(self.reach.low):
            return sight
        if len(sight.position) < 3:
            raise StaleError(
                f"the tip source measures {len(sight.position)} coordinates, task "
                f"{self.task.label!r} needs {self.task.axes}"
            )
        return sight._replace(position=sight.position[self.axes])


def _choose_file(config: EnvConfig, task: Task) -> HardwareFile:
    """Description of the hardware: given, from the robot's file, or the rig's default.

    Raises:
        ValueError: A value that is not allowed, another number of tendons than the task's, or no
            description at all.
        FileNotFoundError: No such file.
    """
    given, robot = config.robot_file, task.robot
    if isinstance(given, str | Path):
        given = find_hardware(Path(given))
    if given is None and robot.hardware is not None:
        given = hardware_of(robot)
    if given is None:
        if not entry_of(robot).on_a_line:
            raise ValueError(
                f"nothing says how the real robot {robot.name!r} is driven: add a table "
                "[hardware] to its file (docs/howto/motors.md), or give robot_file"
            )
        given = rig_file()
    if len(given.tendons) != len(robot.tendons):
        raise ValueError(
            f"robot {given.name!r} has {len(given.tendons)} tendons, the task's robot "
            f"{len(robot.tendons)}"
        )
    return with_port(given, config.port)


def _check_period(file: HardwareFile, control_period: float) -> None:
    """Raise ValueError for a control period [s] that does not fit a robot file.

    It must be longer than the board's wait before it answers, and well below the watchdog's time.
    """
    if control_period <= file.state_delay:
        raise ValueError(
            f"control_period must be longer than the state delay of {file.state_delay:g} s, got "
            f"{control_period:g} s"
        )
    if control_period > file.watchdog / 2:
        raise ValueError(
            f"control_period must be at most half of the watchdog of {file.watchdog:g} s, got "
            f"{control_period:g} s"
        )


class RealEnv(gymnasium.Env[Seen, ndarray]):
    """Move the tip of a real robot along a reference, in real time.

    Actions, observations, rewards and tasks are those of `TrackingEnv` for a robot driven by length
    (of the rig `RigEnv`), so that a policy made for the simulated robot runs here unchanged. A step
    takes one control period by the clock: the action goes out at once, the observation is taken at
    the period's end.

    What differs from the simulation:

    * The robot begins at rest, where it is, with tendons pretensioned; `reset` waits until the tip
      stands still, and the clock starts with the first step. From then on a pause longer than the
      watchdog of the robot file stops the robot.
    * `tip_position` is the newest measurement, some milliseconds old: `info["tip_age"]` [s];
      `info["tip_refused"]` counts messages that its source could not use. `info["error"]` is its
      distance to the reference of its own time.
    * A step called late by half a period or more skips whole periods: the reference continues,
      `info["missed_steps"]` counts them, and nothing is sent twice or in a burst.
    * Actions beyond the calibrated range are limited to it: `info["limited"]` says so, and
      `info["applied_action"]` holds the applied one.
    * `info` also holds `lateness_s` of the call, `rtt_s` from the set-point to its answer (NaN
      without an answer in its period; less than `state_delay` if a measurement was due anyway), the
      age `obs_age_s` of the hardware's measurements, `device_state`, counters of the link
      (`link_crc_errors`, ...) and `fault` (a text, or empty).
    * A fault ends the episode, with its text in `info["failure"]` and the last valid observation:
      `terminated` if a tendon pulled too hard (a limit that simulations have too), else
      `truncated`. A microcontroller ramps down by itself, motors are ramped down by this program.
      After it `step` and `reset` raise `RobotFaultError`, until
      `reset(options={"clear_fault": True})`, which also reopens a lost line and configures a board
      that has restarted.
    * At the end of an episode, in `close` and at the program's exit the robot is ramped down. Any
      exception during a step causes an emergency stop.

    Attributes:
        task, control_period, vector_layout, reading: As in `TrackingEnv`.
        source: "real", for records of episodes.
    """

    metadata: ClassVar = {"render_modes": []}
    spec = EpisodeSpec()
    source = "real"

    takes: ClassVar = REAL_ROBOT
    usual: ClassVar = {"control_period": None}

    def __init__(self, task: str | Task | None = None, **options: Any) -> None:
        """Build the environment; the robot is not touched before the first `reset`.

        Args:
            task: A task that starts at rest, or its name; by default the robot's usual one.
            **options: Those named in `takes`, see `config.EnvConfig`, and those of a task given by
                name.

        Raises:
            ValueError: An option out of range; the message names what is allowed.
            FileNotFoundError: No such robot file.
            TypeError: An unknown option.
        """
        task = usual_task() if task is None else task
        self.config = config = EnvConfig.of(type(self), {"task": task, **options})
        tip = config.tip
        if not (tip is None or callable(getattr(tip, "latest", None))):
            raise ValueError(f"tip must be None or a TipSource (with latest), got {shown(tip)}")
        self._parts = parts = RealParts(config)
        parts.show_in(self)
        file = parts.file
        line = config.line or (lambda: kind_of(file).open(file))
        self._session = RealSession(file, line, tip)
        self._clock = StepClock(self.control_period)
        self._running, self._fault = False, None

    # ------------------------------------------------------------------ episodes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Bring the robot to rest and begin an episode; the first step starts the clock.

        Args:
            seed: Of `np_random`, from which nothing is sampled.
            options: `REAL_OPTIONS` of `envs.options`, see there.

        Raises:
            ValueError: A bad option; the message names what is allowed.
            RobotFaultError: A fault is latched and must not be cleared.
            RobotError: The robot or the tip source does not answer, or the tip does not come to
                rest.
        """
        self._session.check_process()
        super().reset(seed=seed)
        parsed = self._parts.parse_options(options)
        reference = self._parts.reference_of(parsed.changed(self.task))
        self._running = False
        if self._fault is not None and not parsed.clear_fault:
            raise RobotFaultError(self._fault)
        self._session.prepare(parsed.clear_fault)
        measures = self._session.driver.measures_force
        if TENSION in self._parts.observed.spaces and not measures:
            raise RobotError(
                "the robot measures no forces: leave out the observable tendon_tension"
            )
        self._begin(reference)
        return self._observe(), self._info(self._reward.none, monotonic())

    def _begin(self, reference: ReferenceTable) -> None:
        self._reference, self._rows = reference, reference.rows()
        self._index = self._missed = 0
        self._action = [0.0] * self.action_space.shape[0]
        self._fault, self._started, self._limited = None, False, False
        self._lateness, self._round_trip = 0.0, None
        parts = self._parts
        first = parts.placed(self._session.sight())
        self._tip = TipFilter(first, parts.reach, parts.speed)
        self._running = True

    def step(self, action: ndarray) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Apply an action (n_tendons,) in [-1, 1] for one control period, by the clock.

        Raises:
            ValueError: Not n_tendons real numbers, or one beyond [-1, 1] by more than 1e-6.
            RobotFaultError: A fault ended the episode.
            RuntimeError: This is a forked child of the process that made the environment.
            gymnasium.error.ResetNeeded: The episode is over or was never started.
        """
        self._session.check_process()
        if self._fault is not None:
            raise RobotFaultError(self._fault)
        if not self._running:
            raise gymnasium.error.ResetNeeded("call reset() before step(): no episode is running")
        given, _ = one_action(action, self.action_space.shape)
        values = self._parts.wanted(given, np.array(self._action)).tolist()
        try:
            return self._step(values)
        except RobotError as error:
            return self._fail(error)
        except BaseException as error:
            self._running = False
            text = f"emergency stop after {type(error).__name__}: {error}"
            self._fault = FaultInfo(Fault.ESTOP, None, None, text)
            self._session.emergency_stop()
            raise

    def _step(self, values: list[float]) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        if not self._started:
            self._session.driver.arm()
            self._clock.start()
            self._started = True
        self._round_trip = None
        self._lateness, missed = self._clock.begin()
        self._missed += missed
        self._index = min(self._index + missed + 1, self._reference.last_index)
        if self._missed > self.config.max_missed:
            raise TooLateError(
                f"missed {self._missed} steps of {1e3 * self.control_period:g} ms, allowed are "
                f"{self.config.max_missed}"
            )
        wanted = self.input_scale * np.array(values)
        self._limited, self._round_trip = self._session.command(wanted, self._clock.deadline)
        self._clock.finish()
        now = monotonic()
        self._look(now)
        previous, self._action = self._action, values
        measured = _Measured(self._session, self._tip)
        reward, terms = self._reward.terms(self._error(now), values, previous, measured)
        observation, info = self._observe(), self._info(terms, now)
        self._running = self._index < self._reference.last_index
        if not self._running:
            self._session.end()
        return observation, reward, False, not self._running, info

    # ------------------------------------------------------------------ measurements

    def _look(self, now: float) -> None:
        """Read the newest measurements.

        Raises:
            StaleError: A measurement is older than allowed, or the tip is out of reach.
        """
        sight, reading = self._session.sight(), self._session.driver.reading
        ages = {"the tip source": now - sight.time, self._session.whose: reading.age(now)}
        for whose, age in ages.items():
            if age > self.config.oldest:
                raise StaleError(
                    f"the last measurement of {whose} is {1e3 * age:.0f} ms old, allowed are "
                    f"{1e3 * self.config.oldest:.0f} ms"
                )
        self._tip.add(self._parts.placed(sight))

    def _observe(self) -> Seen:
        # Not stored: they would keep an environment alive that nothing else refers to.
        sources = Sources(
            _Measured(self._session, self._tip),
            lambda column: self._rows[column][self._index].copy,
            lambda: np.array(self._action),
        )
        seen = {name: read() for name, read in reads(self._parts.observed, sources)}
        view = self._parts.view
        self._last = seen if view is None else view(seen)
        return self._last

    def _error(self, now: float) -> float:
        """Distance [m] of the newest measurement to the reference of its own time."""
        age = (now - self._tip.time) / self.control_period
        return dist(self._tip.position, reference_at(self._reference.position, self._index - age))

    def _info(self, terms: dict[str, float], now: float) -> dict[str, Any]:
        reading = self._session.driver.reading
        driver, link = self._session.driver, self._session.driver.link
        force = reading.force if driver.measures_force else np.full_like(reading.force, nan)
        link = link | {"nacks": sum(link["nacks"].values())}
        numbers = {
            "time": self._index * self.control_period,
            "error": self._error(now),
            "tip_age": now - self._tip.time,
            "tip_refused": self._session.tip_refused,
            "lateness_s": self._lateness,
            "rtt_s": nan if self._round_trip is None else self._round_trip,
            "obs_age_s": reading.age(now),
            "missed_steps": self._missed,
            **{f"link_{n}": nan if value is None else value for n, value in link.items()},
            **terms,
        }
        return {name: np.float64(number) for name, number in numbers.items()} | {
            "tendon_tension": force.copy(),
            "tendon_length": reading.length.copy(),
            "applied_action": reading.applied / self.input_scale,
            "limited": self._limited,
            "device_state": reading.state.name.lower(),
            "fault": "" if self._fault is None else self._fault.text,
        }

    # ------------------------------------------------------------------ ends

    def _fail(self, error: RobotError) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        self._running = False
        self._session.end()
        fault = error.fault if isinstance(error, RobotFaultError) else None
        self._fault = fault or FaultInfo(Fault.NONE, None, None, str(error))
        reward, terms = self._reward.failed_terms()
        info = self._info(terms, monotonic()) | {"failure": self._fault.text}
        last = each_of(self._last, ndarray.copy)
        terminated = self._fault.code == Fault.FORCE
        return last, reward, terminated, not terminated, info

    def close(self) -> None:
        """Ramp the robot down and close the port; closing twice is harmless."""
        self._running = False
        self._session.close()


class RealRigEnv(RealEnv, gymnasium.Env[Seen, ndarray]):
    """`RealEnv` of the test rig over a serial line: the contract of `RigEnv`.

    Attributes:
        length_scale: [m], pulled in by a full-scale action.
    """

    length_scale = LENGTH_SCALE

    takes: ClassVar = REAL


class _Measured:
    """Measurements of the robot, see `observations.table.Measured`."""

    def __init__(self, session: "RealSession", tip: "TipFilter") -> None:
        self.tip_position = lambda: tip.position.copy()
        self.tip_velocity = lambda: tip.velocity.copy()
        self.tendon_length = lambda: session.driver.reading.length.copy()
        self.tendon_tension = lambda: session.driver.reading.force.copy()


# ---------------------------------------------------------------- robot and tip

#: The tip stands still if it moves by less than this [m] in this time [s].
STILL, STILL_TIME = 1.5e-3, 0.4

_LONGEST_REST = 10.0  # s, for oscillations to decay
_FIRST_SIGHT = 2.0  # s
_POLL = 0.005  # s
_ESTOP_ECHO = 0.3  # s


class TooLateError(RobotError):
    """The policy missed too many control periods."""


class StaleError(RobotError):
    """Measurements are too old, or out of reach."""


class NotStillError(RobotError):
    """The tip does not come to rest."""


class TipFilter:
    """Position and velocity of the tip, from the measurements available at control instants.

    Attributes:
        position: (d,) [m].
        velocity: (d,) [m/s], difference to the last instant with another picture.
        time: [s], when the newest picture was taken.
    """

    def __init__(self, first: TipMeasurement, reach: spaces.Box, speed: float = inf) -> None:
        """Begin with a tip at rest.

        Args:
            first: The first measurement.
            reach: Box of possible positions (d,) [m].
            speed: [m/s], largest possible.

        Raises:
            StaleError: The tip is out of reach.
        """
        self._reach, self._speed = reach, speed
        self._check(first)
        self.position, self.time = first.position, first.time
        self.velocity = np.zeros_like(first.position)

    def add(self, sight: TipMeasurement) -> None:
        """Add the newest measurement at the next instant; a repeated one changes nothing.

        Raises:
            StaleError: The tip is out of reach, or too fast.
        """
        self._check(sight)
        passed = sight.time - self.time
        if passed > 0:
            velocity = (sight.position - self.position) / passed
            fast = hypot(*velocity)
            if not fast <= self._speed:
                raise StaleError(
                    f"the tip source says that the tip moves at {fast:.3g} m/s, allowed are "
                    f"{self._speed:.3g} m/s"
                )
            self.velocity = velocity
            self.position, self.time = sight.position, sight.time

    def _check(self, sight: TipMeasurement) -> None:
        if not self._reach.contains(sight.position):
            place = ", ".join(f"{1e3 * x:.0f}" for x in sight.position)
            raise StaleError(f"the tip source says ({place}) mm, which is out of reach")


def reference_at(points: ndarray, step: float) -> ndarray:
    """Reference (d,) [m] at a fractional step, from its points (n + 1, d) [m] at whole ones."""
    steps = np.arange(len(points))
    return np.array([np.interp(step, steps, column) for column in points.T])


def wait_for_rest(look: Callable[[], TipMeasurement | None], source: str) -> None:
    """Wait until the tip stands still.

    Args:
        look: Returns the newest measurement of the tip, None before the first.
        source: Description of the tip source in the robot file.

    Raises:
        LinkError: No measurement arrives.
        NotStillError: The tip keeps moving.
    """
    begin = monotonic()
    since, place = begin, _first_sight(look, source).position
    while monotonic() - since < STILL_TIME:
        if monotonic() - begin > _LONGEST_REST:
            raise NotStillError(
                f"the tip still moves {_LONGEST_REST:g} s after a stop: more than "
                f"{1e3 * STILL:g} mm in {STILL_TIME:g} s"
            )
        sleep(_POLL)
        sight = look()
        if sight is not None and dist(sight.position, place) > STILL:
            since, place = monotonic(), sight.position


def _first_sight(look: Callable[[], TipMeasurement | None], source: str) -> TipMeasurement:
    end = monotonic() + _FIRST_SIGHT
    while monotonic() < end:
        sight = look()
        if sight is not None and monotonic() - sight.time < STILL_TIME:
            return sight
        sleep(_POLL)
    raise LinkError(
        f"no measurement of the tip in {_FIRST_SIGHT:g} s; the robot file's source is {source}"
    )


class _Opened:
    """Resources that a session has opened and will close."""

    def __init__(self) -> None:
        self.driver: Hardware | None = None
        self.tip: TipSource | None = None

    def close_driver(self) -> None:
        driver, self.driver = self.driver, None
        if driver is not None:
            driver.close()

    def close(self) -> None:
        tip, self.tip = self.tip, None
        try:
            self.close_driver()
        finally:
            if tip is not None:
                tip.close()


class RealSession:
    """A robot and its tip, opened when they are needed.

    A session is closed when nothing refers to it any more.
    """

    def __init__(
        self, file: HardwareFile, line: Callable[[], Transport], tip: TipSource | None
    ) -> None:
        """Prepare a session; nothing is opened yet.

        Args:
            file: Description of the hardware.
            line: Opens the connection to it.
            tip: Source of tip measurements, instead of that in the file.
        """
        self.file, self._line = file, line
        self._range = np.array([[s.minimum, s.maximum] for s in file.tendons]).T
        self.whose = "the motors" if isinstance(file, MotorFile) else "the microcontroller"
        self._given_tip, self._opened = tip, _Opened()
        self._owner = os.getpid()
        weakref.finalize(self, _abandon, self._opened, self._owner).atexit = False

    @property
    def driver(self) -> Hardware | None:
        """The open driver, None before the first episode and after a lost line."""
        return self._opened.driver

    def check_process(self) -> None:
        """Raise RuntimeError in a forked child, where no thread listens to the robot."""
        if os.getpid() != self._owner:
            raise RuntimeError(
                f"this robot is driven by process {self._owner}, and not by this child of it, "
                f"{os.getpid()}"
            )

    @property
    def _tip(self) -> TipSource | None:
        return self._opened.tip if self._given_tip is None else self._given_tip

    # ------------------------------------------------------------------ between episodes

    def prepare(self, clear: bool) -> None:
        """Connect and disarm the robot, and wait until its tip stands still.

        Args:
            clear: Whether to clear a latched fault.

        Raises:
            RobotFaultError: A fault is latched and must not or cannot be cleared.
            RobotError: No answer, no tip, or no rest.
        """
        if clear and self.driver is not None:
            self._revive()
        if self.driver is None:
            self._open(clear)
        if self.driver.fault is not None:
            raise RobotFaultError(self.driver.fault)
        self.driver.stop()
        named = self.file.tip
        wait_for_rest(self.sight, f"{named.kind!r} with {dict(named.options)}")

    def _open(self, clear: bool) -> None:
        if self._tip is None:
            try:
                self._opened.tip = make_tip_source(self.file.tip.kind, self.file.tip.options)
            except OSError as error:
                raise LinkError(f"the tip source does not open: {error}") from error
        self._opened.driver = open_hardware(self.file, self._line())
        try:
            self.driver.connect()
            if clear and self.driver.fault is not None:
                self.driver.clear()
        except BaseException:
            self._opened.close_driver()
            raise

    def _revive(self) -> None:
        """Clear a fault and begin a new connection; a broken one is closed instead.

        Raises:
            RefusedError: The fault's cause is still there.
        """
        try:
            self.driver.stop()
            self.driver.clear()
            self.driver.connect()
        except RefusedError:
            raise
        except RobotError:
            self._opened.close_driver()

    def close(self) -> None:
        """Ramp down and close everything; twice is harmless."""
        self._opened.close()

    # ------------------------------------------------------------------ in an episode

    def command(self, length: ndarray, deadline: float) -> tuple[bool, float | None]:
        """Send lengths (n,) [m], limited to the file's range, and wait for the answer.

        Nothing is sent while the answer to the previous set-point is pending; the age of the
        measurements reveals this.

        Args:
            length: (n,) [m].
            deadline: [s] of waiting.

        Returns:
            Whether the range limited them, and the time [s] until the robot answered; None without
            an answer in time.

        Raises:
            RobotFaultError: The robot has stopped.
        """
        allowed = np.clip(length, *self._range)
        answer = self.driver.exchange(allowed, deadline)
        if self.driver.fault is not None:
            raise RobotFaultError(self.driver.fault)
        return bool(np.any(allowed != length)), None if answer is None else answer.round_trip

    def sight(self) -> TipMeasurement | None:
        """The newest measurement of the tip."""
        reading = self.driver.reading
        if reading is None:
            return self._tip.latest(None, monotonic())
        return self._tip.latest(tuple(reading.adc.tolist()), reading.taken)

    @property
    def tip_refused(self) -> int:
        """Number of messages since opening that the tip source could not use."""
        return getattr(self._tip, "refused", 0)

    def end(self) -> None:
        """Ramp down; if the line is lost, the watchdog does so."""
        with suppress(RobotError):
            self.driver.stop()

    def emergency_stop(self) -> None:
        """Cut the power, and wait briefly for the robot's confirmation.

        If the line is lost, the watchdog stops the robot.
        """
        if self.driver is None:
            return
        with suppress(RobotError):
            self.driver.estop()
            self.driver.wait_for_fault(_ESTOP_ECHO)


def _abandon(opened: _Opened, owner: int) -> None:
    """Close what an abandoned session has left open, in the process that opened it.

    Garbage may be collected in any thread, including the one that listens to the robot, which
    closing needs.
    """
    if os.getpid() != owner:
        return
    if current_thread() is main_thread():
        opened.close()
    else:
        Thread(target=opened.close, name="close robot").start()
