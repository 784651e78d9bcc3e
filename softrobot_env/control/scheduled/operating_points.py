"""Operating points of any robot: equilibria throughout its workspace, as few as an error allows.

A point gives to first order how the inputs and the shape change with the position of the tip.
Between points these predictions are blended (`table.look_up`). Out of many equilibria, those become
points where the blend of the existing points has the largest tip error.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.linalg import lstsq, norm, solve, svd

from softrobot_env.beams.registry import MUJOCO, BeamPlant
from softrobot_env.compile.kernels import kernel, reference
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.core.motion import State
from softrobot_env.core.processes import one_blas_thread
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.inverse import Held, InverseStatics, ReachableEllipse, workspace_of
from softrobot_env.scene.linearised import Linearizer, LinearModel
from softrobot_env.scene.registry import model_scene

from .table import Table, look_up

#: Number of equilibria computed, and the most of them that become points.
CANDIDATES, MOST = 600, 250

#: Error of the tip, over the reach, below which no more points are added.
TOLERANCE = 5e-4

#: Damping of the inverse of the tip's derivative by actions, over its largest singular value.
_DAMPING = 1e-2

#: Share of the candidates in the region of the tasks, and the weight of errors elsewhere.
_ON_GROUND, _OUTSIDE = 0.5, 0.2


#: [1], distance in actions below which two equilibria are the same.
_ALIKE = 1e-6

#: Number of neighbours per term to which the second order of an equilibrium is fitted.
_PER_TERM = 3


class Equilibrium(NamedTuple):
    """A robot at rest.

    Attributes:
        action: (m,) [1].
        curvature: (n,) [1/m].
        tip: (3,) [m].
        model: The linear model about it.
        by_action: X (n, m) [1/m], derivative of the curvature by the actions at rest.
        to_action: P (m, 3) [1/m], actions of least norm that move the tip along the controllable
            directions, with some damping.
        second: (m + n + 3, terms), see `table.Row`.
    """

    action: ndarray
    curvature: ndarray
    tip: ndarray
    model: LinearModel
    by_action: ndarray
    to_action: ndarray
    second: ndarray

    def state(self) -> ndarray:
        """(m + n + 3,): action, curvature and tip."""
        return np.concatenate([self.action, self.curvature, self.tip])


#: Action (m,) [1], curvature (n,) [1/m], tip (3,) [m] and linear model of a robot at rest.
AtRest = tuple[ndarray, ndarray, ndarray, LinearModel]


class OperatingPoints(NamedTuple):
    """Equilibria that represent a workspace.

    Attributes:
        points: The equilibria.
        directions: E (k, 3), unit vectors along which the tip can be controlled.
        errors: (points,) [m], largest error of the tip at any candidate, for each number of points.
        candidates: Number of candidates.
    """

    points: list[Equilibrium]
    directions: ndarray
    errors: ndarray
    candidates: int


@one_blas_thread()
def find_points(
    robot: RobotParams,
    most: int = MOST,
    tolerance: float = TOLERANCE,
    candidates: int = CANDIDATES,
    progress: Callable[[int, int], None] = lambda done, total: None,
    plant: str = MUJOCO,
) -> OperatingPoints:
    """Operating points of a robot, beginning where they reduce the error most.

    Args:
        robot: A robot with tendons.
        most: Largest number of points.
        tolerance: Error of the tip at rest, over the reach, at which no more points are added.
        candidates: Number of equilibria to choose from.
        progress: Called with the numbers of finished and of all candidates.
        plant: Model of the equilibria, one of `beams.registry.PLANTS`; they are computed for the
            inputs that hold the chain throughout the workspace.

    Raises:
        ValueError: The robot has no tendons, or is not driven by length or tension only; or the
            plant cannot model it.
        EquilibriumError: It has no equilibrium under the action 0.
    """
    inverse = InverseStatics(build_scene(model_scene(robot)))
    look = _looking(robot, inverse, plant)
    spatial = inverse.scene.config.bending != "planar" and inverse.freedom > 2
    directions = np.eye(3) if spatial else inverse.directions
    found = []
    for held in _candidates(robot, inverse, directions, candidates, progress):
        try:
            found.append(_equilibrium(directions, look(held)))
        except EquilibriumError:  # another plant may buckle where the chain does not
            if plant == MUJOCO:
                raise
    if not found:
        raise EquilibriumError(f"robot {robot.name!r} rests nowhere as plant {plant!r} has it")
    found = _bent(found, directions)
    ground = workspace_of(robot).ground
    away = norm([directions @ (e.tip - ground.middle) for e in found], axis=1)
    importance = np.where(away <= ground.length, 1.0, _OUTSIDE)
    chosen, errors = _choose(found, directions, importance, most, tolerance * robot.reach)
    return OperatingPoints([found[k] for k in chosen], directions, errors, len(found))


def row_of(point: Equilibrium, gains: ndarray) -> ndarray:
    """(size,) of a point with the gains (k,) of a law, with the layout of `table.split`."""
    stiffness, model = point.model.stiffness, point.model
    forces = np.column_stack([model.mass, model.damping, model.elastic])
    relative = solve(stiffness, forces)
    n = len(stiffness)
    parts = (
        point.action,
        point.curvature,
        point.tip,
        point.to_action,
        point.by_action,
        model.tip,
        relative[:, :n],
        relative[:, n : 2 * n],
        relative[:, 2 * n],
        point.second,
        gains,
    )
    return np.concatenate([np.ravel(part) for part in parts])


def _looking(robot: RobotParams, inverse: InverseStatics, plant: str) -> Callable[[Held], AtRest]:
    """Function from the chain's equilibrium to action, curvature, tip and model of a plant."""
    if plant != MUJOCO:
        beam = BeamLinearizer(robot, plant)
        return lambda held: beam.rest(held.inputs[-1])
    linearizer = Linearizer(inverse.scene)

    def look(held: Held) -> AtRest:
        inputs, angles = held.inputs[-1], held.postures[-1]
        seen = linearizer.action(inputs), linearizer.mean @ angles, linearizer.scene.tip(angles)
        return *seen, linearizer.about(angles, inputs)

    return look


def _equilibrium(directions: ndarray, rest: AtRest) -> Equilibrium:
    action, curvature, _, model = rest
    by_action = solve(model.stiffness, model.inputs)
    moved = directions @ model.tip @ by_action
    left, singular, right = svd(moved, full_matrices=False)
    gain = singular / (singular**2 + (_DAMPING * singular[0]) ** 2)
    to_action = (right.T * gain) @ left.T @ directions
    nothing = np.zeros((len(action) + len(curvature) + 3, len(_products(directions))))
    return Equilibrium(*rest, by_action, to_action, nothing)


def _products(ways: ndarray) -> ndarray:
    """(terms, ...) products of displacements (k, ...), in the order of `table.look_up`."""
    return np.array([ways[x] * ways[y] for x in range(len(ways)) for y in range(x + 1)])


def _bent(found: list[Equilibrium], directions: ndarray) -> list[Equilibrium]:
    """The equilibria with their second order, fitted to the neighbours of each."""
    tips, actions = np.array([e.tip for e in found]), np.array([e.action for e in found])
    states, bent = np.array([e.state() for e in found]), []
    for point in found:
        steps = (tips - point.tip) @ point.to_action.T
        away = np.sum(steps**2, axis=1) + np.sum((point.action + steps - actions) ** 2, axis=1)
        terms = len(_products(directions))
        near = np.argsort(away)[1 : 1 + _PER_TERM * terms]
        bend = steps[near] @ point.by_action.T
        linear = np.hstack([steps[near], bend, bend @ point.model.tip.T])
        products = _products(directions @ (tips[near] - point.tip).T).T
        weight = 1 / np.maximum(away[near], _ALIKE**2)[:, None] ** 0.5
        left = (states[near] - point.state() - linear) * weight
        second = lstsq(products * weight, left, rcond=1e-6)[0].T
        bent.append(point._replace(second=second))
    return bent


def _candidates(
    robot: RobotParams,
    inverse: InverseStatics,
    directions: ndarray,
    count: int,
    progress: Callable[[int, int], None],
) -> Iterator[Held]:
    """Equilibria in the region of the tasks, then in the whole workspace, in all configurations."""
    ground = workspace_of(robot).ground
    first = inverse.solve(ground.middle[None], ground.inputs)
    within = int(count * _ON_GROUND)
    held = [first]
    yield first
    for done, place in enumerate(_disc(ground, within)):
        near = min(held, key=lambda h: norm(inverse.scene.tip(h.postures[-1]) - place))
        found = inverse.solve(place[None], near, anywhere=False)
        progress(done + 1, count)
        if found.errors[-1] <= inverse.tolerance:
            held.append(found)
            yield found
    solver = inverse if len(directions) == 2 else InverseStatics(inverse.scene, directions)
    sample = inverse.sample(count - within)
    for k, tip in enumerate(sample.tips):
        start = Held(sample.inputs[k : k + 1], sample.postures[k : k + 1], np.zeros(1))
        found = solver.solve(tip[None], start, anywhere=False)
        progress(within + k + 1, count)
        if found.errors[-1] <= solver.tolerance:
            yield found


def _disc(ground: ReachableEllipse, count: int) -> ndarray:
    """Points (count, 3) [m], even in an elliptic workspace, from its middle outwards."""
    number = np.arange(1, count + 1)
    spiral = np.sqrt(number / count) * np.exp(1j * np.pi * (3 - np.sqrt(5)) * number)
    size = np.array([ground.length, ground.radius])
    return ground.middle + np.stack([spiral.real, spiral.imag], axis=1) * size @ ground.axes


def _choose(
    found: list[Equilibrium], directions: ndarray, importance: ndarray, most: int, tolerance: float
) -> tuple[list[int], ndarray]:
    """Indices of the points, and the largest error [m] with each number of them.

    Args:
        found: Candidates.
        directions: (k, 3).
        importance: (candidates,) [1], weights of their errors.
        most, tolerance: Where to stop.
    """
    nothing = np.empty(0)
    rows = np.array([row_of(e, nothing) for e in found])
    tips = np.array([e.tip for e in found])
    to_action = np.array([e.to_action for e in found])
    jacobian = np.array([e.model.tip for e in found])
    n, m = found[0].by_action.shape
    chosen, errors = [0], []
    while True:
        near = tips[chosen], to_action[chosen], directions
        table = reference(Table(n, m, *near, np.zeros((m, n)), rows[chosen]))
        off = np.empty(len(found))
        _errors(table, tips, rows, jacobian, off)
        off *= importance
        errors.append(off.max())
        if len(chosen) >= min(most, len(found)) or off.max() <= tolerance:
            return chosen, np.array(errors)
        off[chosen] = 0.0
        chosen.append(int(np.argmax(off)))


@kernel
def _errors(table: Table, tips: ndarray, rows: ndarray, jacobian: ndarray, out: ndarray) -> None:
    """Set out (candidates,) [m] to the tip errors of a blend, by shape or by position."""
    n, m = table.n, table.m
    for i in range(len(tips)):
        now = look_up(table, tips[i], rows[i, :m])
        by_shape = jacobian[i] @ (now.curvature - rows[i, m : m + n])
        by_place = now.tip - tips[i]
        out[i] = np.sqrt(max(np.sum(by_shape**2), np.sum(by_place**2)))


#: [1], step of an action to either side, as in `scene.linearised`.
_SHIFT = 1e-7


class BeamLinearizer:
    """Makes the linear models of a robot's beam model.

    Attributes:
        stepped: The model with its outputs.
        inputs: Of the robot.
    """

    def __init__(self, robot: RobotParams, plant: str) -> None:
        """Build the model.

        Args:
            robot: The robot.
            plant: One of `beams.registry.PLANTS`, except the chain.

        Raises:
            ValueError: The model does not support something that the robot has.
        """
        scene = model_scene(robot)
        self.stepped = BeamPlant(plant)(
            scene.robot,
            axes=slice(0, 3),
            bending=scene.bending,
            torsion=scene.torsion,
            actuation=scene.actuation,
        )
        self.inputs = robot_inputs(robot)
        self._command = self.inputs.per_action().command
        self._bare = self.stepped.bare()
        self._last: ndarray | None = None

    def rest(self, inputs: ndarray) -> AtRest:
        """The robot at rest under inputs (m,) [N or m], starting from the previous solution.

        Raises:
            EquilibriumError: There is none, or it is unstable.
        """
        model, command = self.stepped.model, self.inputs.command(inputs)
        q = self._last = model.equilibrium(command, self._last)
        space = model.linearize(State(q, np.zeros_like(q)), command)
        ways = model.tangent(q)
        rates = [self.stepped.measure(q, np.ascontiguousarray(way)) for way in ways.T]
        mean = np.array([rate.curvature_rate for rate in rates]).T
        tip = np.array([rate.tip_velocity for rate in rates]).T
        action = self.inputs.to_actions(inputs)
        shift = _SHIFT * np.eye(len(action))
        by_action = (self._command(action + shift) - self._command(action - shift)).T / (2 * _SHIFT)
        forces = space.mass @ space.b[len(space.mass) :, : len(by_action)]
        still = np.zeros_like(q)
        elastic = ways.T @ self._bare.residual(q, still, still)
        about = space.mass, space.damping, space.stiffness, forces @ by_action, tip, elastic
        found = LinearModel(*about).seen_as(mean)
        seen = self.stepped.measure(q, still)
        return action, seen.curvature, seen.tip_position, found
