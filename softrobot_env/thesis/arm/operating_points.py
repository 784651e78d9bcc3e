"""Operating points of the arm in closed form, and gains scheduled by them (thesis sec. 6.4).

The linear model at a point; gains on a regular grid of points and in a file, their interpolation;
and what the laws of `control.scheduled` ask for in place of a table: the equilibrium at a
reference.

Without outer forces an equilibrium of the arm is given by one curvature of each third; the
scheduling variables are those of the first piece of each third, sigma = (beta_1, beta_3, beta_5).
"""

from collections.abc import Callable, Iterator
from itertools import islice, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.beams import planar_arm
from softrobot_env.beams.planar_arm import PlanarArm, make_planar_arm
from softrobot_env.compile.kernels import implementation, kernel, reference, structure
from softrobot_env.control.base import FINE, OUTSIDE, UNREACHABLE
from softrobot_env.control.linear_quadratic import discretized, integral_gains
from softrobot_env.control.observers import linear_model
from softrobot_env.control.scheduled.aiming import (
    Seen,
    TrackingTarget,
    aimed,
    references_of,
    remembered,
)
from softrobot_env.control.scheduled.law import Law
from softrobot_env.control.scheduled.lqi import Resting, resting
from softrobot_env.control.scheduled.plan_gains import Regulator, costates
from softrobot_env.core.artifacts import read_arrays, write_arrays
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.artifacts import find_artifact, refuse_artifact, train_command

from ..robots import ARM
from .estimation import stiffness_factor, update_estimate
from .statics import REACH, follow
from .timing import KNOTS, PERIOD, TIMING, identity

#: Points and largest curvature [1/m] along each scheduling variable: 16 x 13 x 11 = 2288 points
#: (audit of sec. 6.4). With 16, none is the straight pose, where the tip's height cannot be
#: controlled to first order.
GRID = ((16, 7.5), (13, 7.2), (11, 7.0))
_LOW = np.array([-limit for _, limit in GRID])
_SPACING = np.array([2 * limit / (count - 1) for count, limit in GRID])

_OFFSET_BANDWIDTH = 100.0  # 1/s, of the difference between measured and modelled tip


@structure
class Grid(NamedTuple):
    """The arm in closed form with gains on a grid of operating points, in place of a `Table`.

    Attributes:
        n, m: Numbers of curvatures and inputs.
        directions: (2, 3), along which the tip moves.
        moment_arms: (m, n), zeros: tendons are driven by tension.
        arm: The nominal arm.
        gains: (n1, n2, n3, k), on the grid, of actions.
        limit: (m,) [N], full-scale inputs.
    """

    n: int
    m: int
    directions: ndarray
    moment_arms: ndarray
    arm: PlanarArm
    gains: ndarray
    limit: ndarray


def read_grid(robot: RobotParams, policy: str, columns: tuple[int, ...], path: Path | None) -> Any:
    """Reference to the `Grid` that a file holds.

    Args:
        robot: Nominal robot.
        policy: Whose gains they are.
        columns: Numbers of gains per input that belong together, which the law reads in turn.
        path: The file; found unless given, see `artifacts.find_artifact`.

    Raises:
        FileNotFoundError, ValueError: As `load_gains`.
    """
    arm, limit = make_planar_arm(robot), TendonMap(robot).input_scale
    path = find_artifact(robot, policy) if path is None else path
    found = load_gains(path, robot, policy, arm.inputs.shape[1] * sum(columns))
    by_input = found.reshape(*found.shape[:3], len(limit), -1) / limit[:, None]
    parts = np.split(by_input, np.cumsum(columns)[:-1], axis=-1)
    gains = np.concatenate([part.reshape(*found.shape[:3], -1) for part in parts], axis=-1)
    n, m = arm.inputs.shape
    return reference(Grid(n, m, np.eye(3)[[0, 2]], np.zeros((m, n)), arm, gains, limit))


def axes() -> list[ndarray]:
    """Values [1/m] along the three axes of the grid."""
    return [np.linspace(-limit, limit, count) for count, limit in GRID]


def operating_points(pieces: int) -> Iterator[ndarray]:
    """Curvatures (pieces,) [1/m] of all points, for thirds of pieces / 3 pieces each."""
    for sigma in product(*axes()):
        yield np.repeat(sigma, pieces // 3)


def mirrored(half: ndarray, states: int, inputs: int) -> ndarray:
    """Gains (n1, n2, n3, k) on the grid from those at beta_1 < 0.

    In a mirror all curvatures, inputs and horizontal positions change sign, heights do not: the
    gains on heights change sign, all others stay.

    Args:
        half: (n1 / 2, n2, n3, k), for each input those on the states, then on pairs (x, z).
        states, inputs: Their numbers.
    """
    signs = np.ones((inputs, half.shape[-1] // inputs))
    signs[:, states + 1 :: 2] = -1.0
    return np.concatenate([half, half[::-1, ::-1, ::-1] * signs.ravel()])


def build_gains(
    robot: RobotParams,
    design: Callable[[ndarray], ndarray],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> ndarray:
    """Gains (n1 / 2, n2, n3, k) at beta_1 < 0, see `mirrored`.

    Args:
        robot: The robot.
        design: Function from the curvature (pieces,) [1/m] of an operating point to gains (k,).
        progress: Called with the numbers of points done and of all points.
    """
    shape = (GRID[0][0] // 2, GRID[1][0], GRID[2][0])
    count, gains = int(np.prod(shape)), []
    for curvature in islice(operating_points(robot.pieces), count):
        gains.append(design(curvature))
        progress(len(gains), count)
    return np.reshape(gains, (*shape, -1))


def save_gains(path: Path, robot: RobotParams, gains: ndarray) -> None:
    """Write what `build_gains` made, in half precision, far finer than its grid."""
    write_arrays(path, {"gains": gains.astype(np.float16), "robot": identity(robot)})


def load_gains(path: Path, robot: RobotParams, policy: str, count: int) -> ndarray:
    """Gains (n1, n2, n3, count) on the whole grid, of which `save_gains` wrote a half.

    Args:
        path: File.
        robot: The robot it is wanted for.
        policy: Whose gains they are, which tells the command that makes them.
        count: Number of gains per point that is wanted.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It belongs to another robot or law, is damaged or not finite.
    """
    if not path.exists():
        command = train_command(robot, policy)
        raise FileNotFoundError(f"no gains at {path}; make them with `{command}`")
    data = read_arrays(path)
    data.check_finite()
    found = data["robot"]
    wanted = identity(robot)
    with data.fitting():
        same = wanted.shape == found.shape and np.allclose(wanted, found, rtol=1e-9)
    if not same:
        refuse_artifact(path, ARM.name, robot, policy)
    data.check_shapes({"gains": (None,) * 4})
    half = data["gains"].astype(np.float64)
    if half.shape != (GRID[0][0] // 2, GRID[1][0], GRID[2][0], count):
        raise ValueError(
            f"{path} does not fit this version: make it anew with `{train_command(robot, policy)}`"
        )
    return mirrored(half, 2 * robot.pieces, len(TendonMap(robot).input_scale))


@kernel
def interpolate(table: ndarray, curvature: ndarray, out: ndarray) -> bool:
    """Set out (k,) to the gains at a curvature (pieces,) [1/m] by trilinear interpolation.

    The table (n1, n2, n3, k) has them on the grid.

    Returns:
        Whether the curvature lies in the grid; outside, the nearest gains on its boundary count.
    """
    third = len(curvature) // 3
    inside = True
    index, share = np.empty(3, np.int64), np.empty(3)
    for axis in range(3):
        count = table.shape[axis]
        place = (curvature[third * axis] - _LOW[axis]) / _SPACING[axis]
        if not 0 <= place <= count - 1:
            inside = False
            place = min(max(place, 0.0), count - 1.0)
        index[axis] = min(int(place), count - 2)
        share[axis] = place - index[axis]
    out[:] = 0
    for corner in range(8):
        weight, i = 1.0, index.copy()
        for axis in range(3):
            if corner >> axis & 1:
                weight, i[axis] = weight * share[axis], i[axis] + 1
            else:
                weight *= 1 - share[axis]
        gains = table[i[0], i[1], i[2]]
        for k in range(len(out)):
            out[k] += weight * gains[k]
    return inside


@implementation(resting, Grid)
@kernel
def _at_rest(grid: Grid, law: Law, target: ndarray, held: ndarray, curvature: ndarray) -> Resting:
    n, m, limit, table = grid.n, grid.m, grid.limit, grid.gains
    inputs, place = held * limit, target[::2].copy()
    rest, inverse, gains = np.empty(n), np.empty((m, 2)), np.empty(table.shape[3])
    gap = follow(grid.arm, place, np.zeros(n), 1.0, limit, inputs, rest, inverse)
    for j in range(m):
        held[j] = inputs[j] / limit[j]
    status_code = _status_code(gap, interpolate(table, curvature, gains))
    return Resting(held, rest, gains, status_code, gap <= REACH)


@kernel
def _status_code(gap: float, inside: bool) -> int:
    """What is said of a distance [m] from the reference, and of a place off the grid."""
    if gap > REACH:
        return UNREACHABLE
    return FINE if inside else OUTSIDE


@kernel
def _estimate(grid: Grid, adaptive: bool, memory: ndarray, seen: Seen) -> float:
    """Update what the nominal model leaves unexplained; the stiffness factor [1]."""
    arm, limit = grid.arm, grid.limit
    own = remembered(memory, grid.n, grid.m)
    point, jacobian = np.empty(2), np.empty((2, grid.n))
    planar_arm.tip(arm, seen.curvature, point, jacobian)
    share = 1.0
    scale = stiffness_factor(adaptive, own.stiffness)
    if own.begun[0]:
        share = 1 - np.exp(-_OFFSET_BANDWIDTH * PERIOD)
        scale = update_estimate(
            arm,
            PERIOD,
            own.curvature,
            own.rate,
            seen.curvature,
            seen.rate,
            seen.previous * limit,
            limit,
            adaptive,
            own.stiffness,
            own.shift,
        )
    for i in range(2):
        own.offset[2 * i] += share * (seen.tip[i] - point[i] - own.offset[2 * i])
    own.begun[0] = 1.0
    own.curvature[:], own.rate[:] = seen.curvature, seen.rate
    return scale


@implementation(aimed, Grid)
@kernel
def _aimed(grid: Grid, law: Law, memory: ndarray, seen: Seen) -> TrackingTarget:
    arm, limit, n, m = grid.arm, grid.limit, grid.n, grid.m
    own = remembered(memory, n, m)
    held, offset = own.held, own.offset
    scale = _estimate(grid, law.adaptive, memory, seen)
    points, velocity = references_of(law, seen.target, seen.preview, own.smoothing)
    inputs, rest, inverse = held * limit, np.empty(n), np.empty((m, 2))
    place = np.array((points[0, 0] - offset[0], points[0, 2] - offset[2]))
    gap = follow(arm, place, own.shift, scale, limit, inputs, rest, inverse)
    action, rising = np.empty(m), np.empty(m)
    for j in range(m):
        held[j] = inputs[j] / limit[j]
        rising[j] = (inverse[j, 0] * velocity[0] + inverse[j, 1] * velocity[2]) / limit[j]
        action[j] = held[j] + arm.damping_time * rising[j]
    gains = np.empty(grid.gains.shape[3])
    status_code = _status_code(gap, interpolate(grid.gains, seen.curvature, gains))
    times, moment_arms, stiffness = law.times, arm.inputs, scale * arm.stiffness
    away, ways = np.empty(2 * n), np.empty(2 * len(times) - 2)
    for i in range(n):
        moving = 0.0
        for j in range(m):
            moving += moment_arms[i, j] * rising[j] * limit[j] / stiffness
        away[i], away[n + i] = seen.curvature[i] - rest[i], seen.rate[i] - moving
    for k in range(1, len(times)):
        for i in range(2):
            way = points[k, 2 * i] - points[0, 2 * i] - times[k] * velocity[2 * i]
            ways[2 * k - 2 + i] = way
    return TrackingTarget(
        action, rising, away, ways, velocity, np.empty((0, 3)), status_code, gains
    )


#: Weights of LQI on the integrated tip error and on the inputs. The thesis gives none; this ratio
#: comes closest to its rise times (audit of sec. 6.4).
ERROR_WEIGHT = 10.0  # 1/(m s)2
LQI_INPUT_WEIGHT = 1e-6  # 1/N2

#: Weights of LQ with preview: sum_k (|e|^2 + VELOCITY_WEIGHT |e.|^2 + INPUT_WEIGHT |u|^2), with e
#: the tip's distance [m] from the reference and u the inputs' [N] from those that hold it.
VELOCITY_WEIGHT = 1e-3  # s2
INPUT_WEIGHT = 3e-7  # m2/N2


def lqi_design(arm: PlanarArm, curvature: ndarray) -> ndarray:
    """Gains [K, K_i] (n_inputs, 2 n + 2) [N] of LQI, flattened.

    Args:
        arm: The arm.
        curvature: (n,) [1/m] of the operating point, which is at rest.
    """
    a, b, c = linear_model(arm, curvature).state_space()
    return integral_gains((a, b), c, LQI_INPUT_WEIGHT, ERROR_WEIGHT).ravel()


def preview_design(arm: PlanarArm, curvature: ndarray) -> ndarray:
    """Gains [N] of u = -K x + sum_i G_i r_i, flattened to (n_inputs * (2 n + 2 * knots),).

    x = (curvatures, rates) and r_i, the reference at the i-th knot, are deviations from an
    operating point.

    Args:
        arm: The arm.
        curvature: (n,) [1/m] of the operating point.
    """
    continuous_a, continuous_b, position = linear_model(arm, curvature).state_space()
    speed = np.roll(position, arm.n, axis=1)
    weight = position.T @ position + VELOCITY_WEIGHT * speed.T @ speed
    # Riccati's equation needs every state in the cost; this is far below the rest.
    weight += 1e-12 * np.eye(len(weight))
    change = INPUT_WEIGHT * np.eye(continuous_b.shape[1])
    system = discretized(continuous_a, continuous_b, PERIOD)
    size = np.ones(len(weight))
    law = Regulator(size, system, (position, speed), VELOCITY_WEIGHT, (weight, change))
    ahead = law.gain @ costates(law, TIMING)[0]
    by_knot = ahead.reshape(len(change), len(KNOTS), 2)
    return np.hstack([law.feedback, by_knot.reshape(len(change), -1)]).ravel()
