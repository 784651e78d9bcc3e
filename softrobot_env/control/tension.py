"""Tension of tendons where they enter the robot, estimated from signals of servos or drives."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs

#: Speed, as a share [1] of the robot's length per second, above which a motor's direction is
#: certain.
_TURNS = 1e-3


class TensionEstimate(NamedTuple):
    """Estimates for n tendons, (n,) each except for the commands.

    Attributes:
        tension: [N], behind the feed line.
        least, most: [N], bounds given by the friction.
        load: (3, n) [N], of the motor or drive, and its bounds given by the friction of the gear.
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

    A motor's control loop applies the force P = K (c - x) - D u, from which the velocity u follows.
    Its impulse over a period, minus the change of the motor's momentum, acts on the load:

        int K (c - x) dt - D dx - m du = int (T' + friction sgn u) dt,

    with cubic interpolation of x between two readings. At rest the load T' keeps its value as long
    as friction can hold it. On a spool the tendon has the tension T = T' / (1 + 2 a x). Behind a
    feed line with the exponent f the tension lies between T exp(-f) and T exp(f), and equals one of
    them while the tendon slides; while it sticks, the last value is returned, which the robot may
    change.

    Attributes:
        requires: Observables that the observer reads.
    """

    def __init__(self, robot: RobotParams, control_period: float) -> None:
        """Set up for a robot, called every control period [s]; ValueError without tendons."""
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
        """The estimate at rest, as if there were no friction."""
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
        """The error (n,) [m] seen by a loop, beyond half a count of its encoder."""
        half = self._drive.encoder_step / 2
        return error - np.clip(error, -half, half)

    def _behind(self, load: ndarray, place: ndarray) -> tuple[ndarray, ndarray, ndarray]:
        """The tension behind the feed line (n,) [N] without friction, and its bounds."""
        tension, low, high = np.maximum(load, 0.0) / (1 + 2 * self._drive.layers * place)
        return tension, low / self._ratio, high * self._ratio
