"""The statics behind the feedforward laws: in closed form, by the MuJoCo chain, or by a network."""

from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy import ndarray
from numpy.linalg import eigh, norm, solve, svd

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.learned.network import check_ends, load_for
from softrobot_env.learned.plain_inference import inference
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import Inputs, robot_inputs
from softrobot_env.robots.artifacts import fingerprint
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.inverse import Held, InverseStatics, Linear, Place, least_step
from softrobot_env.scene.linearised import linearised
from softrobot_env.scene.registry import model_scene

from ..base import REASONS, UNREACHABLE

#: [m/N], singular values of J well below it are not inverted by the closed form's feedback.
_DAMPING = 1e-3
#: The same for a chain, for the full range of actions and over the reach.
_DAMPING_SHARE = 0.04

#: Distance of the tip at rest from the reference, as a share of the reach, beyond which it is out
#: of reach. Paths of tasks are series through solved points, accurate to a hundredth of it.
_OFF = 1e-4
#: Share of it at which a decision is finished, and the most small steps it may take.
_NEAR, _RELAXATIONS = 0.1, 4

#: For the closed form: largest distance [m] from the target, and largest remaining step [N] towards
#: the least norm.
_REACHED, _SHORTEST = 1e-8, 1e-7
_NEWTON_ITERATIONS = 60


class Rest(NamedTuple):
    """An equilibrium of the robot.

    Attributes:
        inputs: (n_inputs,), which hold the tip there.
        error: [m], distance of the tip from the target.
        reached: Whether the tip is on the target.
        place: For a chain, the start of the search for the next point; None at first, if the
            current inputs have no equilibrium.
        spatial: Whether a chain's tip is held in all three coordinates, rather than in two that
            determine the third.
        target: For a network, (k,) [m].
    """

    inputs: ndarray
    error: float = 0.0
    reached: bool = True
    place: Place | None = None
    spatial: bool = False
    target: ndarray | None = None


class Statics(Protocol):
    """Inverse statics of a robot, one decision after the other.

    Attributes:
        inputs: Of the robot, what `robot_inputs` returns.
        dimension: Coordinates of a reference; None if both two and three are accepted.
        missed: Status for a target that is not reached.
    """

    inputs: Inputs
    dimension: int | None
    missed: str

    def begin(self, inputs: ndarray) -> Rest:
        """The equilibrium of the current inputs (n_inputs,)."""

    def hold(self, target: ndarray, before: Rest, first: bool) -> Rest:
        """Inputs of least norm that hold the tip at a target (k,) [m], near the previous ones.

        For the first target they may be anywhere.
        """

    def shifted(self, rest: Rest, change: ndarray) -> tuple[ndarray, bool]:
        """Inputs (n_inputs,) that move the tip by (k,) [m], linearised; if one is limited."""

    def first_mode(self) -> tuple[float, float]:
        """Angular frequency [rad/s] and damping time [s] of the slowest mode."""


def statics_of(
    robot: RobotParams, closed: bool = True, network: str | Path | None = None
) -> Statics:
    """A network, if its file is given; the closed form where there is one; else the chain.

    Raises:
        ValueError: The robot has no tendons, or the network belongs to another robot.
        FileNotFoundError: No such file.
    """
    if network is not None:
        return NetworkStatics(robot, Path(network))
    try:
        return ClosedStatics(robot) if closed else ChainStatics(robot)
    except ValueError:
        return ChainStatics(robot)


class ClosedStatics:
    """`Statics` in closed form: constant curvature between ends of planar pairs, no gravity."""

    dimension = 2
    missed = REASONS[UNREACHABLE]

    def __init__(self, robot: RobotParams) -> None:
        """Raise ValueError for robots without constant-curvature statics."""
        self._robot, self._statics = robot, ConstantCurvatureStatics(robot)
        self.inputs = robot_inputs(robot)
        if self.inputs.unit != "N":
            raise ValueError(f"robot {robot.name!r}: constant-curvature statics are of tensions")

    def begin(self, inputs: ndarray) -> Rest:
        """See `Statics`."""
        return Rest(inputs)

    def hold(self, target: ndarray, before: Rest, first: bool) -> Rest:
        """See `Statics`. Out of reach, the inputs of the smallest residual."""
        return least_norm(self._statics, target, before.inputs)

    def shifted(self, rest: Rest, change: ndarray) -> tuple[ndarray, bool]:
        """See `Statics`."""
        jacobian = self._statics.jacobian(rest.inputs)
        square = jacobian @ jacobian.T + _DAMPING**2 * np.eye(2)
        inputs = rest.inputs + jacobian.T @ solve(square, change)
        return inputs, bool(np.any(np.abs(inputs) > self._statics.limit))

    def first_mode(self) -> tuple[float, float]:
        """See `Statics`."""
        return 2 * np.pi * self._robot.first_frequency, self._robot.damping_time


def least_norm(statics: ConstantCurvatureStatics, target: ndarray, guess: ndarray) -> Rest:
    """Inputs of least norm, near a guess, that hold the tip on a target.

    Minimises |u|^2 / 2 subject to tip(u) = target by a range- and null-space Newton method with
    step control.

    Args:
        statics: Of the robot.
        target: (2,) [m], (x, z).
        guess: (n_inputs,) [N], start; the nearest local minimum is found.

    Returns:
        Equilibrium at a local minimum of the norm; if the target cannot be reached from the guess,
        that of the smallest distance encountered.
    """
    u = np.array(guess, float)
    best = Rest(u, np.inf, False)
    for _ in range(_NEWTON_ITERATIONS):
        tip, first, second = statics.expand(u)
        gap = np.asarray(target) - tip
        away = float(np.hypot(*gap))
        if away < best.error:
            best = Rest(u, away, False)
        to_range, to_null = _newton_steps(u, gap, first, second)
        if away < _REACHED and np.max(np.abs(to_null)) < _SHORTEST:
            return Rest(u, away)
        u = u + _shorten(to_range, statics.limit) + _shorten(to_null, statics.limit)
    return best


def _newton_steps(
    u: ndarray, gap: ndarray, first: ndarray, second: ndarray
) -> tuple[ndarray, ndarray]:
    """Step towards the target in the row space of J, and down |u|^2 in its null space."""
    left, singular, right = svd(first)
    # Near the straight pose J loses rank; the damping bounds the step there and vanishes with
    # the gap, so it does not disturb convergence.
    damping = 1e-3 * np.hypot(*gap) * singular[0]
    # A straight arm with its tip on the target, where both are exactly zero: no step.
    gain = singular / (singular**2 + damping + np.finfo(float).tiny)
    range_, null = right[: len(singular)].T, right[len(singular) :].T
    to_range = range_ @ (gain * (left.T @ gap))
    multiplier = -left @ (gain * (range_.T @ u))
    bend = np.eye(len(u)) + multiplier[0] * second[0] + multiplier[1] * second[1]
    hessian = null.T @ bend @ null
    values, vectors = eigh(hessian)
    slope = vectors.T @ (null.T @ u)
    return to_range, -null @ (vectors @ (slope / np.maximum(np.abs(values), 0.1)))


def _shorten(step: ndarray, limit: ndarray) -> ndarray:
    """The step, scaled down to at most a tenth of the tension limit."""
    return step / max(1.0, np.max(np.abs(step) / (0.1 * limit)))


class NetworkStatics:
    """`Statics` by a network from the position of the tip to the actions that hold it there.

    It is trained on samples of the inverse statics, of the chain or a robot
    (`training.quasi_static`).
    """

    missed = "outside the trained workspace"

    def __init__(self, robot: RobotParams, path: Path) -> None:
        """Load the network; raises the errors of `statics_of`."""
        self._robot, self.inputs = robot, robot_inputs(robot)
        network, about = load_for(path, robot, "qs_nn", fingerprint)
        self._size = 2 if robot.moves_in_xz else network.sizes[0]
        check_ends(network, (self._size, self.inputs.n_inputs), str(path))
        # The height of a tip that moves freely in two coordinates alone follows from them.
        self.dimension = None if self._size == 2 and not robot.moves_in_xz else self._size
        about.check_shapes({"tips": (None, self._size), "spacing": ()})
        self._network = inference(network)
        self._tips, self._spacing = about["tips"], float(about["spacing"])

    def begin(self, inputs: ndarray) -> Rest:
        """See `Statics`; nothing is remembered."""
        return Rest(inputs)

    def hold(self, target: ndarray, before: Rest, first: bool) -> Rest:
        """See `Statics`."""
        target = target[: self._size].copy()
        action = self._network(target)
        away = float(np.sqrt(((self._tips - target) ** 2).sum(axis=1).min()))
        inputs = self.inputs.from_actions(action)
        return Rest(inputs, away, away <= self._spacing, target=target)

    def shifted(self, rest: Rest, change: ndarray) -> tuple[ndarray, bool]:
        """See `Statics`: the output of the network for the shifted position."""
        inputs = self.hold(rest.target + change[: self._size], rest, False).inputs
        limited = np.abs(inputs - self.inputs.input_centre) >= self.inputs.input_scale
        return inputs, bool(limited.any())

    def first_mode(self) -> tuple[float, float]:
        """See `Statics`: of the chain."""
        return ChainStatics(self._robot).first_mode()


class ChainStatics:
    """`Statics` by the MuJoCo chain, each decision starting from the one before.

    References may have two coordinates, x and z of a planar robot and x and y of a spatial one, or
    three; a third that does not follow from the other two is followed too if the robot has enough
    inputs.

    Attributes:
        scene: Of the robot.
        inverse: Inverse along the robot's own directions, which determine a third coordinate.
        world: Inverse along x, y and z.
        damping: [m], singular values of the tip's Jacobian by actions well below it are not
            inverted.
    """

    dimension = None
    missed = REASONS[UNREACHABLE]

    def __init__(self, robot: RobotParams) -> None:
        """Accept any robot with tendons; ValueError for others."""
        self.scene = build_scene(model_scene(robot))
        self.inverse = InverseStatics(self.scene)
        self.world = self.inverse.along(np.eye(3))
        self.inputs = self.inverse.inputs
        self._off, self.damping = _OFF * robot.reach, _DAMPING_SHARE * robot.reach

    def begin(self, inputs: ndarray) -> Rest:
        """See `Statics`."""
        try:
            return Rest(inputs, place=self.inverse.place(inputs))
        except EquilibriumError:  # a motion may begin out of equilibrium
            return Rest(inputs)

    def hold(self, target: ndarray, before: Rest, first: bool) -> Rest:
        """See `Statics`. Out of reach, the inputs within their limits that come nearest."""
        if before.place is not None:
            ways = (True, False) if before.spatial else (False, True)
            for spatial in ways if self._can_lift(target) else (False,):
                rest = self._followed(target, before.place, spatial)
                if rest is not None and rest.reached:
                    return rest
        return self._searched(target, before, first)

    def _followed(self, target: ndarray, place: Place, spatial: bool) -> Rest | None:
        """One step or several: with a third coordinate, until the inputs have the least norm."""
        solver, rest = self.solver(spatial), None
        for _ in range(_RELAXATIONS):
            found = solver.follow(self.point(target, spatial), place)
            if found is None:
                return None
            rest, place = self._rest(found, target, spatial), found
            if rest.error <= _NEAR * self._off:
                break
        return rest

    def linearised(self, rest: Rest) -> Linear | None:
        """The linear statics about a rest, along the directions in which it is held."""
        return self.solver(rest.spatial).linearised(rest.place.action, rest.place.posture)

    def shifted(
        self, rest: Rest, change: ndarray, linear: Linear | None = None
    ) -> tuple[ndarray, bool]:
        """See `Statics`. Actions at their bound stay there, and the others compensate.

        Uses the linear statics about the rest, unless those of a robot that differs are given.
        """
        place = rest.place
        if linear is None and place is not None:
            linear = self.world.linearised(place.action, place.posture, driven=True)
        if linear is None:
            return rest.inputs, True
        axes = self.axes(len(change))
        gap = change - (linear.tip_by_turns @ linear.balance)[axes]
        step = least_step(linear.tip_by_actions[axes], gap, place.action, 0.0, self.damping)
        inputs = rest.inputs + self.world.inputs_by(place.action, step)
        limited = np.abs(inputs - self.inputs.input_centre) >= self.inputs.input_scale
        return inputs, bool(limited.any() or np.any(np.abs(place.action + step) >= 1.0))

    def first_mode(self) -> tuple[float, float]:
        """See `Statics`: of the chain linearised under the action 0, with fixed drives."""
        return linearised(self.inverse, self.inputs.input_centre).first_mode()

    def error(self, posture: ndarray, target: ndarray) -> float:
        """Distance [m] of the tip in a posture (nq,) from all coordinates of a target (k,)."""
        return float(norm(self.inverse.tip(posture)[self.axes(len(target))] - target))

    def solver(self, spatial: bool) -> InverseStatics:
        """The inverse along all three directions, or along its own."""
        return self.world if spatial else self.inverse

    def _can_lift(self, target: ndarray) -> bool:
        return len(target) == 3 and self.inverse.freedom > 2

    def axes(self, size: int) -> list[int]:
        """The world coordinates that a reference of two or three refers to."""
        if size == 3:
            return [0, 1, 2]
        return [0, 2] if self.scene.config.bending == "planar" else [0, 1]

    def point(self, target: ndarray, spatial: bool) -> ndarray:
        """The target along the directions of a solver."""
        return self.solver(spatial).directions[:, self.axes(len(target))] @ target

    def _rest(self, found: Place, target: ndarray, spatial: bool) -> Rest:
        error = self.error(found.posture, target) if np.isfinite(found.error) else np.inf
        return Rest(found.inputs, error, error <= self._off, found, spatial)

    def _searched(self, target: ndarray, before: Rest, first: bool) -> Rest:
        """Solved from the previous place, or from anywhere; if that fails, the place is kept."""
        point = np.zeros((1, 3))
        point[0, self.axes(len(target))] = target
        start, best = before.place, None
        for spatial in (False, True) if self._can_lift(target) else (False,):
            held = None if start is None else Held(start.inputs[None], start.posture[None], None)
            found = self.solver(spatial).solve(point, held, first)
            place = self.inverse.place(found.inputs[0], found.postures[0])
            place = place._replace(error=found.errors[0])
            rest = self._rest(place, target, spatial)
            best = rest if best is None or rest.error < best.error else best
            if best.reached:
                return best
        return best._replace(place=start)
