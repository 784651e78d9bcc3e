"""Tension of tendons where they enter the robot, from what servos or drives tell."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs

#: Share [1] of the robot's length in a second, beyond which it is clear which way a motor turns.
_TURNS = 1e-3


class TensionEstimate(NamedTuple):
    """What is known of n tendons, (n,) each but for the commands.

    Attributes:
        tension: [N], behind the feed line.
        least, most: [N], between which friction keeps it.
        load: (3, n) [N], of the motor or drive, and between which friction of the gear keeps it.
        place, speed: [m, m/s], of the motor.
        commands: (k, n) [m], the last ones, newest first.
    """

    tension: ndarray
    least: ndarray
    most: ndarray
    load: ndarray
    place: ndarray
    speed: ndarray
    commands: ndarray


class TensionObserver:
    """Estimates the tension behind the friction of gears and feed lines.

    A motor's loop has the force P = K (c - x) - D u, of which P tells u. What the loop has given in
    a period, but for what has made the motor faster, its load has taken:

        int K (c - x) dt - D dx - m du = int (T' + friction sgn u) dt,

    with x between two readings as a cubic. At rest the load T' is what it was, as long as friction
    holds that. On a spool the tendon has the tension T = T' / (1 + 2 a x). The feed line, with the
    exponent f, keeps what is behind it between T exp(-f) and T exp(f), one of which it is while the
    tendon slides; while it sticks, what is told is the last, which the robot may change.

    Attributes:
        requires: Observables that it reads.
    """

    def __init__(self, robot: RobotParams, control_period: float) -> None:
        """Of a robot with tendons, called every control period [s]; ValueError without any."""
        check_argument("control_period", control_period, Positive)
        if not robot.tendons:
            raise ValueError(f"robot {robot.name!r} has no tendons, hence no tension")
        self._drive, self._period = robot.drive, control_period
        self._by_motor = robot.drive.gain is not None
        motors = ("motor_force", "tendon_length", "previous_action")
        self.requires = motors if self._by_motor else ("tendon_tension",)
        lines = [t.feed_line for t in robot.tendons]
        self._ratio = np.exp([0.0 if line is None else line.exponent for line in lines])
        self._slow, self._inputs = _TURNS * robot.length, robot_inputs(robot)
        periods, late = divmod(robot.drive.command_delay / control_period, 1.0)
        self._shares, self._first = np.array([[1 - late], [late]]), int(periods)

    def start(self, observation: Observation) -> TensionEstimate:
        """At rest, as if nothing rubbed."""
        load = np.tile(observation[self.requires[0]], (3, 1))
        still = np.zeros_like(load[0])
        place = observation["tendon_length"] if self._by_motor else still
        commands = np.tile(place, (self._first + 2, 1))
        return TensionEstimate(*self._behind(load, place), load, place, still, commands)

    def update(self, before: TensionEstimate, observation: Observation) -> TensionEstimate:
        """The estimate a control period later."""
        if self._by_motor:
            now = self._of_motors(before, observation)
        else:
            now = before._replace(load=np.tile(observation[self.requires[0]], (3, 1)))
        _, least, most = self._behind(now.load, now.place)
        return now._replace(tension=np.clip(before.tension, least, most), least=least, most=most)

    def _of_motors(self, before: TensionEstimate, observation: Observation) -> TensionEstimate:
        drive, period = self._drive, self._period
        push, place = observation["motor_force"], observation["tendon_length"]
        newest = self._inputs.from_actions(observation["previous_action"])
        commands = np.vstack([newest, before.commands[:-1]])
        in_force = commands[self._first : self._first + 2]
        way = place - before.place
        speed = way / period
        weak = np.abs(push) >= drive.force_limit * (1 - 1e-6)
        if drive.velocity_gain > 0:
            told = (drive.gain * self._felt(in_force[0] - place) - push) / drive.velocity_gain
            speed = np.where(weak, speed, told)
        mean = (place + before.place) / 2 + period / 12 * (before.speed - speed)
        given = drive.gain * self._felt((self._shares * in_force).sum(axis=0) - mean)
        given = np.where(weak, push, given - drive.velocity_gain * way / period)
        given = given - drive.reflected_mass * (speed - before.speed) / period
        turns = np.sign(way) * (np.abs(way) > self._slow * period)
        rubs = drive.gear_friction
        low, high = (given - rubs * np.where(turns == 0, side, turns) for side in (1, -1))
        load = np.stack([np.clip(before.load[0], low, high), low, high])
        return before._replace(load=load, place=place, speed=speed, commands=commands)

    def _felt(self, error: ndarray) -> ndarray:
        """What a loop sees of its error (n,) [m], but for half a count of its encoder."""
        half = self._drive.encoder_step / 2
        return error - np.clip(error, -half, half)

    def _behind(self, load: ndarray, place: ndarray) -> tuple[ndarray, ndarray, ndarray]:
        """What is behind the feed line (n,) [N] where it does not rub, at least and at most."""
        tension, low, high = np.maximum(load, 0.0) / (1 + 2 * self._drive.layers * place)
        return tension, low / self._ratio, high * self._ratio
