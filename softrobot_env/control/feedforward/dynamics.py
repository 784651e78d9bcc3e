"""Inverse dynamics of any robot: servo constraints on its MuJoCo chain, about its statics.

The tip is to move along z(t) (servo constraint, thesis (5.30) to (5.33)). Were the motion slow, the
chain would go through its equilibria q_s(z). Inertia and damping along them, w = M q_s'' + D q_s' +
C(q_s, q_s'), move the posture by x and ask for more tension, by the actions a_d:

    K x + M x'' + D x' = B a_d - w,    J x = 0,

with the stiffness K, the tensions' moment arms B and the tip's Jacobian J in that equilibrium.
Friction along tendons takes from their tensions, by the ways that q_s' slides them, and is part of
w where the robot has it, so that tensions at the drives make up for it. What
is left besides the tip, the internal dynamics, is not integrated: it need not be stable, as the
tip of a bending robot is not minimum phase. Instead it is taken as quasi-static first, x_0, then M
and D act on x_0(t), a series in the square of the reference's frequency over those of the chain
with its tip held. Of the a_d that do it, those with the least norm are taken, within the limits.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.linalg import norm, solve

from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import find_artifact
from softrobot_env.scene.inverse import Linear, least_step
from softrobot_env.scene.tangent import RubbingForces

from ..base import REASONS, SATURATED
from .law import Feedforward, FeedforwardPI, FeedforwardState
from .motion import Motion, ahead_of
from .nearby import Neighbourhood
from .statics import ChainStatics, NetworkStatics, Rest

#: Share of the reach within which the path of equilibria is taken as a parabola.
_NEAR = 5e-3

#: x(t) at the last instants -> its rate and its second derivative, over the period and its square.
_FIRST, _SECOND = np.array([1.5, -2.0, 0.5, 0.0]), np.array([2.0, -5.0, 4.0, -1.0])

#: Way of the tip, over `_NEAR` of the reach, that a part of the tensions left out must be worth.
_FELT = 1.0

#: Share [1] of the robot's length by which a tendon slides until its friction is the other way, and
#: rounds in which tensions and their friction are found.
_TURNING, _ROUNDS = 2e-4, 3

_SLOW, _FAST = "servo too slow", "reference too fast for the internal dynamics"


class Moving(NamedTuple):
    """Memory of the inverse dynamics.

    Attributes:
        acceleration: (k,) [m/s2], of the last reference; None at the start.
        inputs: (n_inputs,), the last ones wanted; None at the start.
        shifts: (up to 3, nv) [rad], x_0 at the last instants, newest first.
        slid: (zones,) [1], how tendons slide along their ways, see `RubbingForces.of_sliding`.
    """

    acceleration: ndarray | None = None
    inputs: ndarray | None = None
    shifts: tuple[ndarray, ...] = ()
    slid: ndarray | None = None


class InverseDynamics(Feedforward):
    """Inputs that move the tip along the reference, by the dynamics of the robot's chain.

    They hold for a control period, so they are those for the middle of it. The state's `status`
    says besides what `Feedforward` says where an input is at its limit, a servo is too slow, or the
    reference is so fast that the internal dynamics cannot be told from the equilibria.
    """

    requires = ("reference", "reference_velocity", "reference_acceleration", "previous_action")
    _begun = Moving()

    def __init__(
        self, robot: RobotParams, control_period: float, weights: str | Path | None = None
    ) -> None:
        """Find the statics.

        Args:
            robot: With tendons.
            control_period: [s] between calls.
            weights: File of a network, whose statics count in place of the chain's (the hybrid law
                of thesis sec. 5.3): s = network(z) + s_dyn, (5.36) to (5.39).

        Raises:
            ValueError: The robot has no tendons, or the network is of another robot.
            FileNotFoundError: No such file.
        """
        check_argument("control_period", control_period, Positive)
        super().__init__(robot, control_period, closed=False)
        self._statics: ChainStatics
        self._network = None if weights is None else NetworkStatics(robot, Path(weights))
        if self._network is not None and self._network.dimension is not None:
            self.sizes |= dict.fromkeys(self._points(), self._network.dimension)
        self._period, self._speed = control_period, robot.drive.speed
        self._lag = _lag(robot)
        self._near = _NEAR * robot.reach
        self._turning = _TURNING * robot.length if robot.has_capstan_friction else None
        self._rubbing: RubbingForces | None = None

    def _motion(self, observation: Observation, state: FeedforwardState) -> Motion:
        """The reference in the middle of the period."""
        now = Motion(*(observation[name] for name in self.requires[:3]))
        return now.ahead(self._period / 2, state.memory.acceleration, self._period)

    def _added(
        self, observation: Observation, motion: Motion, rest: Rest, state: FeedforwardState
    ) -> tuple[ndarray, Moving, str | None]:
        """Inputs of the motion; at rest those of the statics."""
        place, velocity, acceleration = motion
        now = observation["reference_acceleration"].copy()
        linear = self._statics.linearised(rest) if rest.reached else None
        if linear is None:
            return rest.inputs, Moving(now), None
        wanted = self._moving(rest, linear, velocity, acceleration, state.memory)
        inputs, shifts, slid, reason = wanted
        if self._network is not None:
            known = self._network.hold(place, rest, False)
            inputs = known.inputs + (inputs - rest.inputs)
            reason = reason if known.reached else self._network.missed
        driven, late = self._driven(inputs, state.memory.inputs)
        return driven, Moving(now, inputs, shifts, slid), reason or late

    def _moving(
        self, rest: Rest, linear: Linear, velocity: ndarray, acceleration: ndarray, memory: Moving
    ) -> tuple[ndarray, tuple[ndarray, ...], ndarray | None, str | None]:
        """Inputs, the next shifts and ways of sliding, and what is to be said."""
        place, solver = rest.place, self._statics.solver(rest.spatial)
        rate, change = self._through_rests(rest, linear, velocity, acceleration)
        force = solver.forces.of_motion(place.posture, rate, change)
        step, shift = self._balanced(place.action, linear, force)
        shifts, reason = (shift, *memory.shifts)[:4], None
        if len(shifts) == 4:
            stack = np.array(shifts)
            more = solver.forces.of_motion(
                place.posture, _FIRST @ stack / self._period, _SECOND @ stack / self._period**2
            )
            full, moved = self._balanced(place.action, linear, force + more)
            share = min(1.0, norm(shift) / max(norm(moved - shift), 1e-12))
            step, shift = step + share * (full - step), shift + share * (moved - shift)
            felt = linear.tip_by_actions @ (full - step)
            if share < 1 and norm(felt) > _FELT * self._near:
                reason = _FAST
        slid = None
        if self._turning is not None:
            more, moved, slid = self._against_friction(rest, linear, rate, step, memory.slid)
            step, shift = step + more, shift + moved
        posture = solver.moved(place.posture, shift)
        inputs = solver.inputs_for(place.action + step, posture)
        limited = np.abs(place.action + step).max() >= 1.0
        return inputs, shifts[:3], slid, REASONS[SATURATED] if limited else reason

    def _against_friction(
        self, rest: Rest, linear: Linear, rate: ndarray, step: ndarray, slid: ndarray | None
    ) -> tuple[ndarray, ndarray, ndarray]:
        """Change (m,) of the actions that makes up for friction along tendons, shift, and ways."""
        place, solver = rest.place, self._statics.solver(rest.spatial)
        if self._rubbing is None:
            self._rubbing = RubbingForces(solver.forces.model, place.posture)
        way = self._rubbing.rates(place.posture, rate) * self._period / self._turning
        slid = np.clip(way if slid is None else slid + way, -1.0, 1.0)
        more = np.zeros_like(step)
        for _ in range(_ROUNDS):
            action = np.clip(place.action + step + more, -1.0, 1.0)
            force = self._rubbing.of_sliding(place.posture, solver.controls_for(action), slid)
            more, moved = self._balanced(place.action + step, linear, -force)
        return more, moved, slid

    def _through_rests(
        self, rest: Rest, linear: Linear, velocity: ndarray, acceleration: ndarray
    ) -> tuple[ndarray, ndarray]:
        """Rate and second derivative (nv,) of the posture along the equilibria of the reference."""
        speed, pull = norm(velocity), norm(acceleration)
        if speed == pull == 0:
            return np.zeros((2, len(linear.stiffness)))
        h = min(self._near / max(speed, 1e-12), np.sqrt(self._near / max(pull, 1e-12)))
        solver = self._statics.solver(rest.spatial)
        along = solver.directions[:, self._statics.axes(len(velocity))]
        turns = [
            self._beside(rest, linear, along @ (sign * h * velocity + h * h / 2 * acceleration))
            for sign in (1, -1)
        ]
        return (turns[0] - turns[1]) / (2 * h), (turns[0] + turns[1]) / h**2

    def _beside(self, rest: Rest, linear: Linear, way: ndarray) -> ndarray:
        """Turns (nv,) from a rest to that of a tip a small way (k,) [m] beside it."""
        place, solver = rest.place, self._statics.solver(rest.spatial)
        target = linear.tip + way
        action, posture = place.action, place.posture
        for near in (linear, None):
            near = near or solver.linearised(action, posture)
            if near is None:
                return solver.turns(place.posture, posture)
            step = least_step(near.tip_by_actions, target - near.tip, action, 0.0)
            turn = near.balance + near.by_actions @ step
            action, posture = action + step, solver.moved(posture, turn)
        return solver.turns(place.posture, posture)

    def _balanced(self, action: ndarray, linear: Linear, force: ndarray) -> tuple[ndarray, ndarray]:
        """Change (m,) of the actions, and shift (nv,), under more force without the tip moving."""
        bent = solve(linear.stiffness, force)
        step = least_step(linear.tip_by_actions, linear.tip_by_turns @ bent, action, 0.0)
        return step, linear.by_actions @ step - bent

    def _driven(self, wanted: ndarray, before: ndarray | None) -> tuple[ndarray, str | None]:
        """Commands with which servos are on average where they should be in a period."""
        if before is None or (np.isinf(self._speed) and not self._lag.any()):
            return wanted, None
        rate = (wanted - before) / self._period
        driven = wanted + ahead_of(rate, self._period, self._speed, self._lag)
        return driven, _SLOW if np.abs(rate).max() > self._speed else None


def _lag(robot: RobotParams) -> ndarray:
    """(n_tendons,) [m] by which tendons wound up by servos lag behind, whichever way they move."""
    if robot.drive.kind != "length":
        return np.zeros(1)
    return robot.drive.backlash / 2 + robot.of_tendons("friction") / robot.of_tendons("stiffness")


class InverseDynamicsPI(FeedforwardPI, InverseDynamics):
    """The inverse dynamics with `Feedback` that learns how the robot differs from its model."""

    requires = (*InverseDynamics.requires, "tip_position")

    def _learning(self, period: float) -> Neighbourhood:
        return Neighbourhood(self._statics, period)


def make_hybrid(
    robot: RobotParams, control_period: float, identified: str | Path | None = None
) -> InverseDynamics:
    """Statics of a network of places and the dynamics of the chain.

    Args:
        robot: Nominal robot.
        control_period: [s] between calls.
        identified: File of the network; found unless given, see `artifacts.find_artifact`.

    Raises:
        ValueError, FileNotFoundError: No network of this robot, or no such file.
    """
    if not isinstance(identified, str | Path | None):
        raise ValueError(f"robot {robot.name!r} takes a network of its statics, not of a rig")
    weights = find_artifact(robot, "qs_nn") if identified is None else identified
    return InverseDynamics(robot, control_period, weights=weights)
