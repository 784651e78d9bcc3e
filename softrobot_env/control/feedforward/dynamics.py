"""Inverse dynamics of any robot: servo constraints on its MuJoCo chain, around its statics.

The tip should move along z(t) (servo constraint, thesis (5.30) to (5.33)). In a slow motion the
chain would pass through its equilibria q_s(z). Inertia and damping along them, w = M q_s'' + D q_s'
+ C(q_s, q_s'), shift the posture by x and require additional actions a_d:

    K x + M x'' + D x' = B a_d - w,    J x = 0,

with the stiffness K, the tensions' moment arms B and the tip's Jacobian J in that equilibrium.
Friction along tendons reduces their tension according to how q_s' slides them; where the robot has
friction it is part of w, so that the tensions at the drives compensate for it. The remaining
internal dynamics is not integrated: it may be unstable, because the tip of a bending robot is not
minimum phase. Instead it is first taken as quasi-static, x_0, and then M and D act on x_0(t): a
series in the squared ratio of the reference's frequency to those of the chain with its tip held.
Among the a_d that satisfy this, those of least norm are taken, within the limits.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.linalg import norm, pinv, solve

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import find_artifact
from softrobot_env.scene.inverse import InverseStatics, Linear, least_step
from softrobot_env.scene.tangent import RubbingForces

from ..base import REASONS, SATURATED
from .commands import Commands
from .law import Feedforward, FeedforwardPI, FeedforwardState
from .motion import Motion
from .nearby import Neighbourhood
from .statics import ChainStatics, NetworkStatics, Rest

#: Share of the reach within which the path of equilibria is approximated by a parabola.
_NEAR = 5e-3

#: x(t) at the last instants -> its rate and its second derivative, over the period and its square.
_FIRST, _SECOND = np.array([1.5, -2.0, 0.5, 0.0]), np.array([2.0, -5.0, 4.0, -1.0])

#: Tip motion by the neglected tensions, over `_NEAR` of the reach, from which on a reference is too
#: fast.
_FELT = 1.0

#: Iterations at most for tensions and their friction, largest step of an action in one,
#: and sums [rad] of the joint angles in one and in the last.
_ROUNDS, _LARGEST, _LARGE_TURN, _BALANCED = 30, 0.3, 1.0, 1e-4

#: Remaining joint angles [rad] above which friction counts as not converged.
_LOST = 1e-2

#: Factors on the compliance of friction zones, tried in turn where friction does not converge at
#: once.
_LOOSER = (64.0, 0.25, 0.25, 0.25)

#: Periods of the first mode that a jump lasts, and its overshoot, over the gap: with too few
#: tensions for all coordinates, a tip comes to rest nearer to a point that it returns to.
_STRAIGHT, _BEYOND = (1.0, 0.0), (2.0, 0.45)

#: Largest over mean speed of the smooth motion.
_STEEPEST = 15 / 8

_FAST = "reference too fast for the internal dynamics"


class Moving(NamedTuple):
    """Memory of the inverse dynamics.

    Attributes:
        acceleration: (k,) [m/s2], of the last reference; None at the start.
        inputs: (n_inputs,), the last ones wanted; None at the start.
        rate: (n_inputs,), their last rate; None at the start.
        shifts: (up to 3, nv) [rad], x_0 at the last instants, newest first.
        rubbed: `anchors` and `came` of `RubbingForces`.
        more, turned: (m,) and (nv,), changes of actions and posture due to friction.
        eased: What is left of a jump of the reference; None without one.
    """

    acceleration: ndarray | None = None
    inputs: ndarray | None = None
    rate: ndarray | None = None
    shifts: tuple[ndarray, ...] = ()
    rubbed: tuple[ndarray, ndarray] | None = None
    more: ndarray | None = None
    turned: ndarray | None = None
    eased: "Eased | None" = None


class Eased(NamedTuple):
    """A jump of the reference, replaced by a smooth motion.

    Attributes:
        gap: (n_inputs,), inputs before it minus those at its end.
        lasts, time: [s], its duration and the time passed.
        beyond: Overshoot in between, over the gap.
    """

    gap: ndarray
    lasts: float
    beyond: float
    time: float = 0.0

    def left(self, later: float = 0.0) -> ndarray:
        """What is left of the gap (n_inputs,) some time [s] later, along a minimum-jerk motion.

        The overshoot has as many vanishing derivatives at both ends.
        """
        x = min(max((self.time + later) / self.lasts, 0.0), 1.0)
        straight = 1 - x**3 * (10 - 15 * x + 6 * x * x)
        return (straight - self.beyond * (4 * x * (1 - x)) ** 3) * self.gap


class InverseDynamics(Feedforward):
    """Inputs that move the tip along the reference, by the dynamics of the robot's chain.

    They hold for a control period, so they are computed for its middle. In addition to what
    `Feedforward` reports, the state's `status` says where an input is at its limit, a servo is too
    slow, or the reference is too fast for the series about the equilibria.
    """

    requires = ("reference", "reference_velocity", "reference_acceleration", "previous_action")
    _begun = Moving()

    def __init__(
        self, robot: RobotParams, control_period: float, weights: str | Path | None = None
    ) -> None:
        """Set up the statics.

        Args:
            robot: A robot with tendons.
            control_period: [s] between calls.
            weights: File of a network whose statics replace the chain's (the hybrid law of thesis
                sec. 5.3): s = network(z) + s_dyn, (5.36) to (5.39).

        Raises:
            ValueError: The robot has no tendons, or the network belongs to another robot.
            FileNotFoundError: No such file.
        """
        check_argument("control_period", control_period, Positive)
        super().__init__(robot, control_period, closed=False)
        self._statics: ChainStatics
        self._network = None if weights is None else NetworkStatics(robot, Path(weights))
        if self._network is not None and self._network.dimension is not None:
            self.sizes |= dict.fromkeys(self._points(), self._network.dimension)
        self._period, self._commands = control_period, Commands(robot, control_period)
        self._near = _NEAR * robot.reach
        self._rubs = robot.has_capstan_friction
        self._first = 2 * np.pi / self._statics.first_mode()[0]
        self._rubbing: RubbingForces | None = None
        asked = len(self._statics.inverse.directions)
        self._jump = _BEYOND if self._statics.inverse.freedom < asked else _STRAIGHT

    def _motion(self, observation: Observation, state: FeedforwardState) -> Motion:
        """The reference in the middle of the time in which the commands act."""
        now = Motion(*(observation[name] for name in self.requires[:3]))
        return now.ahead(
            self._period / 2 + self._commands.late, state.memory.acceleration, self._period
        )

    def _added(
        self, observation: Observation, motion: Motion, rest: Rest, state: FeedforwardState
    ) -> tuple[ndarray, Moving, str | None]:
        """Inputs of the motion; at rest, those of the statics."""
        memory, way = state.memory, rest
        now = observation["reference_acceleration"].copy()
        eased = self._jumped(motion, rest, state)
        if eased is not None:
            found = self._on_the_way(rest, eased, state)
            way, eased = (rest, None) if found is None else (found[0], eased)
        linear = self._statics.linearised(way) if rest.reached else None
        if linear is None:
            return rest.inputs, Moving(now, rubbed=memory.rubbed), None
        if eased is None:
            rate, change = self._through_rests(rest, linear, motion.velocity, motion.acceleration)
        else:
            _, rate, change = found
        inputs, tension, moved, reason = self._moving(way, linear, rate, change, memory)
        if self._network is not None:
            known = self._network.hold(motion.position, rest, False)
            inputs = known.inputs + (inputs - rest.inputs)
            reason = reason if known.reached else self._network.missed
        driven, rate, late = self._commands.leading(inputs, tension, memory.inputs, memory.rate)
        moved = moved._replace(acceleration=now, inputs=inputs, rate=rate, eased=eased)
        return driven, moved, reason or late

    def _jumped(self, motion: Motion, rest: Rest, state: FeedforwardState) -> Eased | None:
        """The smooth motion to a rest, after a jump now or recently; None without one.

        A robot that swings would be stopped by friction anywhere, so the motion must not make it
        swing.
        """
        before, eased = state.rest, state.memory.eased
        if not self._rubs or before.place is None or not rest.reached:
            return None
        if eased is not None:
            eased = eased._replace(time=eased.time + self._period)
            eased = None if eased.time >= eased.lasts else eased
        came = self._period / 2 + self._commands.late
        came = self._period if state.memory.inputs is not None else came
        expected = motion.position - came * motion.velocity
        if self._statics.error(before.place.posture, expected) <= self._near:
            return eased
        gap = before.inputs - rest.inputs + (0.0 if eased is None else eased.left())
        periods, beyond = self._jump
        lasts = max(periods * self._first, _STEEPEST * np.abs(gap).max() / self._commands.speed)
        return Eased(gap, lasts, beyond, self._period / 2)

    def _on_the_way(
        self, rest: Rest, eased: Eased, state: FeedforwardState
    ) -> tuple[Rest, ndarray, ndarray] | None:
        """The equilibrium on the way to a rest, its rate and second derivative (nv,).

        None if there is none.
        """
        solver, period, postures = self._statics.solver(rest.spatial), self._period, []
        guess = state.rest.place.posture
        try:
            for later in (-period, 0.0, period):
                guess = solver.posture(self._within(rest.inputs + eased.left(later)), guess)
                postures.append(guess)
        except EquilibriumError:
            return None
        inputs = self._within(rest.inputs + eased.left())
        back, on = (solver.turns(postures[1], x) for x in postures[::2])
        way = rest._replace(inputs=inputs, place=solver.place(inputs, postures[1]))
        return way, (on - back) / (2 * period), (on + back) / period**2

    def _within(self, inputs: ndarray) -> ndarray:
        """The nearest inputs (n_inputs,) within their limits."""
        return self._inputs.from_actions(np.clip(self._inputs.to_actions(inputs), -1.0, 1.0))

    def _moving(
        self, way: Rest, linear: Linear, rate: ndarray, change: ndarray, memory: Moving
    ) -> tuple[ndarray, ndarray, Moving, str | None]:
        """Inputs, tensions at the drives, the next memory, and the status."""
        place, solver = way.place, self._statics.solver(way.spatial)
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
            force = force + share * more
        posture, action = solver.moved(place.posture, shift), place.action + step
        moved = Moving(shifts=shifts[:3])
        if self._rubs:
            action, posture, known = self._against_friction(way, force, action, posture, memory)
            moved = known._replace(shifts=shifts[:3])
        inputs, tension = solver.inputs_for(action, posture), solver.tensions(action)
        limited = np.abs(action).max() >= 1.0
        return inputs, tension, moved, REASONS[SATURATED] if limited else reason

    def _against_friction(
        self, rest: Rest, force: ndarray, action: ndarray, posture: ndarray, memory: Moving
    ) -> tuple[ndarray, ndarray, Moving]:
        """Actions (m,) and posture (nq,) that compensate for friction along tendons; next memory.

        The friction is that of the modelled motion so far (Newton's method).

        Args:
            rest: The rest with the tip on its target.
            force: (nv,) [N m], required by the motion.
            action, posture: Values without friction.
            memory: Memory of the last decision.
        """
        solver = self._statics.solver(rest.spatial)
        if memory.rubbed is None or self._rubbing is None:
            self._rubbing = RubbingForces(solver.forces.model, rest.place.posture)
        if memory.rubbed is not None:
            self._rubbing.anchors, self._rubbing.came = memory.rubbed
        start = action, posture
        if memory.more is not None:
            start = action + memory.more, solver.moved(posture, memory.turned)
        held, there, found = self._held(solver, rest, force, action, *start)
        for factor in () if found else _LOOSER:
            self._rubbing.loosen(factor)
            held, there, found = self._held(solver, rest, force, action, held, there)
        self._rubbing.force(there, solver.controls_for(held))
        self._rubbing.stay()
        more, turned = held - action, solver.turns(posture, there)
        rubbed = self._rubbing.anchors, self._rubbing.came
        return held, there, Moving(rubbed=rubbed, more=more, turned=turned)

    def _held(
        self,
        solver: InverseStatics,
        rest: Rest,
        force: ndarray,
        plain: ndarray,
        action: ndarray,
        posture: ndarray,
    ) -> tuple[ndarray, ndarray, bool]:
        """Actions (m,) and posture (nq,) that hold the tip still under friction and a force.

        And whether they do, at least nearly. Found by Newton's method from the given ones; their
        components that do not move the tip are those of `plain` (m,).
        """
        rubbing = solver.under(self._rubbing)
        target = solver.directions @ solver.tip(rest.place.posture)
        least, step, turn = np.inf, np.zeros_like(action), np.zeros_like(force)
        for k in range(_ROUNDS):
            linear = rubbing.linearised(action, posture, less=force)
            left = np.inf
            if linear is not None:
                more = least_step(linear.tip_by_actions, target - linear.tip, action, 0.0)
                if k == 0:
                    moves = pinv(linear.tip_by_actions) @ linear.tip_by_actions
                    more += (plain - action) - moves @ (plain - action)
                turned = linear.balance + linear.by_actions @ more
                left = np.abs(turned).sum()
            if left < _BALANCED:
                return action, posture, True
            if left < least:
                size = max(1.0, np.abs(more).max() / _LARGEST, left / _LARGE_TURN)
                least, step, turn = left, more / size, turned / size
                action, posture = action + step, solver.moved(posture, turn)
            else:  # past the point where a zone starts to slide
                step, turn = step / 2, turn / 2
                action, posture = action - step, solver.moved(posture, -turn)
        return action, posture, least < _LOST

    def _through_rests(
        self, rest: Rest, linear: Linear, velocity: ndarray, acceleration: ndarray
    ) -> tuple[ndarray, ndarray]:
        """Rate and second derivative (nv,) of the posture along the reference's equilibria."""
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
        """Joint displacements (nv,) to the rest whose tip is a small step (k,) [m] away."""
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
        """Change (m,) of actions and shift (nv,) that balance a force without moving the tip."""
        bent = solve(linear.stiffness, force)
        step = least_step(linear.tip_by_actions, linear.tip_by_turns @ bent, action, 0.0)
        return step, linear.by_actions @ step - bent


class InverseDynamicsPI(FeedforwardPI, InverseDynamics):
    """Inverse dynamics with `Feedback` that learns how the robot differs from its model."""

    requires = (*InverseDynamics.requires, "tip_position")

    def _learning(self, period: float) -> Neighbourhood:
        return Neighbourhood(self._statics, period)


def make_hybrid(
    robot: RobotParams, control_period: float, identified: str | Path | None = None
) -> InverseDynamics:
    """Statics by a network and dynamics by the chain.

    Args:
        robot: Nominal robot.
        control_period: [s] between calls.
        identified: File of the network; by default searched for, see `artifacts.find_artifact`.

    Raises:
        ValueError, FileNotFoundError: No network for this robot, or no such file.
    """
    if not isinstance(identified, str | Path | None):
        raise ValueError(f"robot {robot.name!r} takes a network of its statics, not of a rig")
    weights = find_artifact(robot, "qs_nn") if identified is None else identified
    return InverseDynamics(robot, control_period, weights=weights)
