"""Gains on a regular grid of operating points, and their interpolation (thesis sec. 6.4).

Without outer forces an equilibrium of the arm is given by one curvature of each third; the
scheduling variables are those of the first piece of each third, sigma = (beta_1, beta_3, beta_5).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from softrobot_env.beams.numerics.compilation import kernel, reference, structure
from softrobot_env.robots import RobotParams

#: Points and largest curvature [1/m] along each scheduling variable: 16 x 13 x 11 = 2288 points
#: (audit of sec. 6.4). With 16, none is the straight pose, where the tip's height cannot be
#: controlled to first order.
GRID = ((16, 7.5), (13, 7.2), (11, 7.0))


@structure
class GainTable(NamedTuple):
    """Gains on a grid; spacing is equal along each axis.

    Attributes:
        low: (3,) [1/m], first point of each axis.
        spacing: (3,) [1/m].
        gains: (n1, n2, n3, k), in whatever units the policy needs.
    """

    low: np.ndarray
    spacing: np.ndarray
    gains: np.ndarray


@dataclass(frozen=True)
class OperatingPoint:
    """A point of the grid.

    Attributes:
        index: Place (i, j, k) in the grid.
        curvature: (pieces,) [1/m].
    """

    index: tuple[int, int, int]
    curvature: np.ndarray


def axes() -> list[np.ndarray]:
    """Values [1/m] along the three axes of the grid."""
    return [np.linspace(-limit, limit, count) for count, limit in GRID]


def operating_points(pieces: int) -> Iterator[OperatingPoint]:
    """All points, for a robot whose thirds have pieces / 3 pieces each."""
    points = axes()
    for index in product(*(range(len(axis)) for axis in points)):
        sigma = [axis[i] for axis, i in zip(points, index, strict=True)]
        yield OperatingPoint(index, np.repeat(sigma, pieces // 3))


def build_gains(
    robot: RobotParams,
    design: Callable[[np.ndarray], np.ndarray],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> np.ndarray:
    """Gains (n1, n2, n3, k) on the grid.

    Args:
        robot: The robot.
        design: Function from the curvature (pieces,) [1/m] of an operating point to gains (k,).
        progress: Called with the numbers of points done and of all points.
    """
    shape = tuple(count for count, _ in GRID)
    total, table = int(np.prod(shape)), None
    for done, point in enumerate(operating_points(robot.pieces)):
        gains = design(point.curvature)
        table = np.empty((*shape, len(gains))) if table is None else table
        table[point.index] = gains
        progress(done + 1, total)
    return table


def identity(robot: RobotParams) -> np.ndarray:
    """What a gain table depends on: numbers that tell robots apart."""
    ends = [t.end for t in robot.tendons]
    radii = [t.offset[0] for t in robot.tendons]
    own = (robot.length, robot.bending_stiffness, robot.mass_per_length, robot.damping_time)
    return np.array([*own, float(robot.pieces), *ends, *radii])


def save_gains(path: Path, robot: RobotParams, gains: np.ndarray) -> None:
    """Write gains (n1, n2, n3, k), in single precision, which is far finer than they need be."""
    np.savez_compressed(path, gains=gains.astype(np.float32), robot=identity(robot))


def load_gains(path: Path, robot: RobotParams, command: str, count: int) -> GainTable:
    """Read what `save_gains` wrote.

    Args:
        path: File.
        robot: The robot it is wanted for.
        command: The command that makes the file, for the error message.
        count: Number of gains per point that is wanted.

    Returns:
        The table, as a reference for kernels.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It belongs to another robot or law.
    """
    if not path.exists():
        raise FileNotFoundError(f"no gains at {path}; make them with `{command}`")
    with np.load(path) as data:
        found, gains = data["robot"], np.ascontiguousarray(data["gains"], dtype=np.float64)
    wanted = identity(robot)
    if wanted.shape != found.shape or not np.allclose(wanted, found, rtol=1e-9):
        raise ValueError(
            f"{path} holds gains of another robot than this {robot.name!r}; `build_gains` and "
            "`save_gains` make a table for it, which the policy takes as gains="
        )
    if gains.shape != (*(size for size, _ in GRID), count):
        raise ValueError(f"{path} does not fit this version; `{command}` makes it anew")
    points = axes()
    low = np.array([axis[0] for axis in points])
    spacing = np.array([axis[1] - axis[0] for axis in points])
    return reference(GainTable(low, spacing, gains))


@kernel
def interpolate(table: GainTable, curvature: np.ndarray, out: np.ndarray) -> bool:
    """Set out (k,) to the gains at a curvature (pieces,) [1/m] by trilinear interpolation.

    Returns:
        Whether the curvature lies in the grid; outside, the nearest gains on its boundary count.
    """
    third = len(curvature) // 3
    inside = True
    index, share = np.empty(3, np.int64), np.empty(3)
    for axis in range(3):
        count = table.gains.shape[axis]
        place = (curvature[third * axis] - table.low[axis]) / table.spacing[axis]
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
        gains = table.gains[i[0], i[1], i[2]]
        for k in range(len(out)):
            out[k] += weight * gains[k]
    return inside
