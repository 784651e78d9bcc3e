"""Tip tracking with the real test rig over a serial line; the contract of `RigEnv`."""

from collections.abc import Callable
from math import dist, nan
from pathlib import Path
from time import monotonic
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

from softrobot_env.envs.observables import observation_space
from softrobot_env.envs.options import action_values, check_arguments, known_options
from softrobot_env.envs.real_options import (
    OPTIONS,
    check_watchdog,
    choose_robot_file,
    choose_task,
    task_for,
)
from softrobot_env.envs.real_session import RealSession, StaleError, TooLateError
from softrobot_env.envs.reference import TOP, sample_reference
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.rig_observables import DEFAULT_RIG_OBSERVABLES, RIG_OBSERVABLES, RigSizes
from softrobot_env.envs.sights import Sights, reference_at
from softrobot_env.envs.step_clock import StepClock
from softrobot_env.hardware.config import RobotFile
from softrobot_env.hardware.errors import RobotError, RobotFaultError
from softrobot_env.hardware.messages import Capability, Fault
from softrobot_env.hardware.readings import FaultInfo
from softrobot_env.hardware.tip import Sight, TipSource
from softrobot_env.hardware.transport import SerialTransport, Transport
from softrobot_env.interfaces import Observation
from softrobot_env.rig_tasks import LENGTH_SCALE, RigTask
from softrobot_env.scene.quadrature import place_hinges
from softrobot_env.scene.registry import RIG_PIECES

#: What the rig cannot measure.
_UNSEEN = ("curvature", "curvature_rate")

_TENSION = "tendon_tension"  # needs a board that measures forces


class RealRigEnv(gymnasium.Env[Observation, np.ndarray]):
    """Move the tip of the real rig along a reference in x and y, in real time.

    Actions, observations, rewards and tasks are those of `RigEnv`, so that a policy made for the
    simulated rig runs here unchanged. A step takes one control period by the clock: the action
    goes out at once, the observation is taken at the period's end.

    What differs, because this is no simulation:

    * The rig begins where it is, at rest with tendons pretensioned; `reset` waits until the tip
      stands still, and the clock starts with the first step. From then on a pause longer than the
      watchdog of the robot file stops the rig.
    * `tip_position` is the newest measurement, some milliseconds old: `info["tip_age"]` [s].
      `info["error"]` is its distance to the reference of its own time.
    * A step called late by half a period or more skips whole periods: the reference goes on,
      `info["missed_steps"]` counts them, nothing is sent twice or in a burst.
    * Actions beyond the calibrated range go as far as it allows: `info["limited"]` says so, and
      `info["applied_action"]` what the servos were driven to.
    * `info` also holds `lateness_s` of the call, `rtt_s` of the set-point, `obs_age_s` of what the
      microcontroller measured, `device_state`, `link` (counters) and `fault` (text or None).
    * A fault ends the episode, with its text in `info["failure"]` and the last valid observation:
      `terminated` where a tendon pulled too hard (a limit that simulations have too), else
      `truncated`. The microcontroller ramps down by itself. After it `step` and `reset` raise
      `RobotFaultError`, until `reset(options={"clear_fault": True})`.
    * At the end of an episode, in `close` and at the program's exit the rig is ramped down.
      Any exception in the middle of a step is an emergency stop.

    Attributes:
        task, control_period, length_scale: As in `RigEnv`.
        source: "real", for records of episodes.
    """

    metadata: ClassVar = {"render_modes": []}
    axes = TOP
    length_scale = LENGTH_SCALE
    source = "real"

    def __init__(
        self,
        task: str | RigTask = "triangle",
        *,
        port: str | None = None,
        robot_file: str | Path | RobotFile | None = None,
        line: Callable[[], Transport] | None = None,
        tip: TipSource | None = None,
        control_period: float | None = None,
        observe: tuple[str, ...] | str = DEFAULT_RIG_OBSERVABLES,
        preview: tuple[float, ...] = (0.05, 0.1, 0.2, 0.4),
        reward: TrackingReward | None = None,
        max_missed: int = 25,
        oldest: float = 0.1,
        **task_options: float,
    ) -> None:
        """Build the environment; the robot is not touched before the first `reset`.

        Args:
            task: Task or its name; only tasks that start at rest.
            port: Serial port instead of the robot file's.
            robot_file: Calibration and limits, or the path of its TOML file; the default one of
                the rig unless given.
            line: Opens the way to the microcontroller, instead of the serial port.
            tip: Measures the tip, instead of what the robot file names.
            control_period: [s], instead of the robot file's; less than half of its watchdog.
            observe: Names of the observables in an observation, or "all", which are those that
                every rig has; "tendon_tension" needs a board that measures forces.
            preview: Times [s] ahead of now of `reference_preview`.
            reward: Weights and scales of the reward.
            max_missed: Control periods that may be missed in an episode.
            oldest: [s], oldest measurement that is still good.
            **task_options: Of a task given by name, see `rig_tasks.make_rig_task`.

        Raises:
            ValueError: An argument out of range; the message names what is allowed.
            FileNotFoundError: No such robot file.
        """
        self.task = choose_task(task, task_options)
        file = choose_robot_file(robot_file, port, self.task)
        self.control_period = file.control_period if control_period is None else control_period
        check_arguments(self.control_period, preview, (1, 1))
        check_watchdog(file, self.control_period)
        self._max_missed, self._oldest = max_missed, oldest
        self._preview = np.array(preview, dtype=float)
        self._reward = TrackingReward() if reward is None else reward
        self._session = RealSession(
            file, line or (lambda: SerialTransport(file.port, file.baud)), tip
        )
        self._make_spaces(observe)
        self._clock = StepClock(self.control_period)
        self._running, self._fault = False, None

    def _make_spaces(self, observe: tuple[str, ...] | str) -> None:
        robot = self.task.robot
        known = {name: make for name, make in RIG_OBSERVABLES.items() if name not in _UNSEEN}
        names = (observe,) if isinstance(observe, str) else observe
        if observe == "all":
            names = [name for name in known if name != _TENSION]
        layout = place_hinges(robot.length, RIG_PIECES, "balanced2")
        sizes = RigSizes(robot, layout, len(self._preview), self.length_scale)
        self.observation_space = observation_space(tuple(names), sizes, known)
        self._tip_space = known["tip_position"](sizes)
        self._action_shape = (sizes.n_tendons,)
        self.action_space = spaces.Box(-1.0, 1.0, self._action_shape, dtype=np.float32)

    # ------------------------------------------------------------------ episodes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Bring the rig to rest and begin an episode; the first step starts the clock.

        Args:
            seed: Of `np_random`, from which nothing is drawn.
            options: See `OPTIONS`.

        Raises:
            ValueError: A bad option; the message names what is allowed.
            RobotFaultError: A fault is latched and not to be cleared.
            RobotError: The robot or the tip source does not answer, or the rig does not come to
                rest.
        """
        super().reset(seed=seed)
        given = known_options(options, OPTIONS)
        task = task_for(self.task, given)
        reference = sample_reference(task, self.control_period, self._preview, self.axes)
        self._running = False
        if self._fault is not None and given.get("clear_fault") is not True:
            raise RobotFaultError(self._fault)
        self._session.prepare(clear=given.get("clear_fault") is True)
        self._fault, self._started, self._limited = None, False, False
        self._check_forces()
        self._reference, self._rows = reference, reference.rows()
        self._index = self._missed = 0
        self._action = [0.0] * self._action_shape[0]
        sight = self._session.sight()
        self._sights = Sights(sight)
        self._check_tip(sight)
        self._running = True
        return self._observe(), self._info({}, 0.0, monotonic())

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply an action (n_tendons,) in [-1, 1] for one control period, by the clock.

        Raises:
            ValueError: Wrong shape, NaN, or a value outside [-1, 1].
            RobotFaultError: A fault ended the episode.
            gymnasium.error.ResetNeeded: The episode is over or was never started.
        """
        if self._fault is not None:
            raise RobotFaultError(self._fault)
        if not self._running:
            raise gymnasium.error.ResetNeeded("call reset() before step(): no episode is running")
        values = action_values(action, self._action_shape)
        try:
            return self._step(values)
        except RobotError as error:
            return self._fail(error)
        except BaseException as error:
            self._running = False
            self._session.emergency_stop()
            text = f"emergency stop after {type(error).__name__}: {error}"
            self._fault = FaultInfo(Fault.ESTOP, None, None, text)
            raise

    def _step(self, values: list[float]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        if not self._started:
            self._session.arm()
            self._clock.start()
            self._started = True
        lateness, missed = self._clock.begin()
        self._missed += missed
        self._index = min(self._index + missed + 1, self._reference.last_index)
        if self._missed > self._max_missed:
            raise TooLateError(
                f"missed {self._missed} steps of {1e3 * self.control_period:g} ms, allowed are "
                f"{self._max_missed}"
            )
        wanted = self.length_scale * np.array(values)
        self._limited = self._session.command(wanted, self._clock.deadline)
        self._clock.finish()
        now = monotonic()
        self._look(now)
        previous, self._action = self._action, values
        terms = self._reward.terms(self._error(now), values, previous)
        observation, info = self._observe(), self._info(terms, lateness, now)
        self._running = self._index < self._reference.last_index
        if not self._running:
            self._session.end()
        return observation, sum(terms.values()), False, not self._running, info

    # ------------------------------------------------------------------ measurements

    def _look(self, now: float) -> None:
        """Take in the newest measurements.

        Raises:
            StaleError: One is older than allowed, or the tip is out of reach.
        """
        sight, reading = self._session.sight(), self._session.reading
        ages = {"the tip source": now - sight.time, "the microcontroller": now - reading.time}
        for name, age in ages.items():
            if age > self._oldest:
                raise StaleError(
                    f"the last measurement of {name} is {1e3 * age:.0f} ms old, allowed are "
                    f"{1e3 * self._oldest:.0f} ms"
                )
        self._check_tip(sight)
        self._sights.add(sight)

    def _check_tip(self, sight: Sight) -> None:
        if not self._tip_space.contains(sight.position):
            x, y = 1e3 * sight.position
            raise StaleError(f"the tip source says ({x:.0f}, {y:.0f}) mm, which is out of reach")

    def _check_forces(self) -> None:
        able = Capability.FORCE in self._session.capabilities
        if _TENSION in self.observation_space.spaces and not able:
            raise RobotError(
                "the board measures no forces: leave out the observable tendon_tension"
            )

    def _observe(self) -> Observation:
        reading = self._session.reading
        measured = {
            "tip_position": self._sights.position.copy(),
            "tip_velocity": self._sights.velocity.copy(),
            "tendon_length": reading.length.copy(),
            "tendon_tension": reading.force.copy(),
            "previous_action": np.array(self._action),
        }
        measured |= {name: rows[self._index].copy() for name, rows in self._rows.items()}
        self._last = {name: measured[name] for name in self.observation_space}
        return self._last

    def _error(self, now: float) -> float:
        """Distance [m] of the newest measurement to the reference of its own time."""
        age = (now - self._sights.time) / self.control_period
        return dist(
            self._sights.position, reference_at(self._reference.position, self._index - age)
        )

    def _info(self, terms: dict[str, float], lateness: float, now: float) -> dict[str, Any]:
        reading = self._session.reading
        able, link = Capability.FORCE in self._session.capabilities, self._session.link()
        return {
            "time": self._index * self.control_period,
            "error": self._error(now),
            "tip_age": now - self._sights.time,
            "tendon_tension": reading.force.copy() if able else np.full(self._action_shape, nan),
            "tendon_length": reading.length.copy(),
            "reward_terms": terms,
            "applied_action": reading.applied / self.length_scale,
            "limited": self._limited,
            "lateness_s": lateness,
            "rtt_s": link["round_trip"],
            "obs_age_s": now - reading.time,
            "missed_steps": self._missed,
            "device_state": reading.state.name.lower(),
            "link": link,
            "fault": None if self._fault is None else self._fault.text,
        }

    # ------------------------------------------------------------------ ends

    def _fail(
        self, error: RobotError, lateness: float = 0.0
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        self._running = False
        self._session.end()
        told = error.fault if isinstance(error, RobotFaultError) else None
        self._fault = told or FaultInfo(Fault.NONE, None, None, str(error))
        terms = self._reward.failed_terms()
        info = self._info(terms, lateness, monotonic()) | {"failure": self._fault.text}
        last = {name: value.copy() for name, value in self._last.items()}
        terminated = self._fault.code == Fault.FORCE
        return last, sum(terms.values()), terminated, not terminated, info

    def close(self) -> None:
        """Ramp the rig down and close the port; closing twice is harmless."""
        self._running = False
        self._session.close()
