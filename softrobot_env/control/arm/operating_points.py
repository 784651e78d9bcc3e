"""Laws whose gains are scheduled by the operating point (thesis sec. 6.4).

The linear model at a point, gains on a regular grid of points and in a file, their interpolation.

Without outer forces an equilibrium of the arm is given by one curvature of each third; the
scheduling variables are those of the first piece of each third, sigma = (beta_1, beta_3, beta_5).
"""

from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from softrobot_env.artifacts import (
    find_artifact,
    read_arrays,
    refuse_artifact,
    train_command,
)
from softrobot_env.beams.closed_forms import planar_arm
from softrobot_env.beams.closed_forms.planar_arm import PlanarArm, make_planar_arm
from softrobot_env.beams.numerics.compilation import kernel, reference, structure
from softrobot_env.control.arm.statics import REACH
from softrobot_env.control.arm.timing import PERIOD, identity
from softrobot_env.control.base import Controller, hold_for, state_sizes
from softrobot_env.control.limits import finite, limited
from softrobot_env.control.status import (
    FINE,
    OUTSIDE,
    SATURATED,
    UNREACHABLE,
)
from softrobot_env.interfaces import Observation
from softrobot_env.robots import ARM, RobotParams
from softrobot_env.robots.actuation import TendonMap

#: Points and largest curvature [1/m] along each scheduling variable: 16 x 13 x 11 = 2288 points
#: (audit of sec. 6.4). With 16, none is the straight pose, where the tip's height cannot be
#: controlled to first order.
GRID = ((16, 7.5), (13, 7.2), (11, 7.0))
_LOW = np.array([-limit for _, limit in GRID])
_SPACING = np.array([2 * limit / (count - 1) for count, limit in GRID])


@structure
class Law(NamedTuple):
    """What the kernel of a law needs of a robot; one argument is faster to pass than three.

    Attributes:
        arm: The nominal arm.
        gains: (n1, n2, n3, k), on the grid, in whatever units the policy needs.
        limit: (n_inputs,) [N], full-scale inputs.
    """

    arm: PlanarArm
    gains: np.ndarray
    limit: np.ndarray


class ScheduledController(Controller):
    """A controller that decides every millisecond by gains out of a table, in one kernel."""

    def __init__(
        self, robot: RobotParams, control_period: float, name: str, gains: Path | None, count: int
    ) -> None:
        """Load the gain table.

        Args:
            robot: Nominal robot.
            control_period: [s] between calls, a part of 1 ms or 1 ms.
            name: Of the policy.
            gains: Gain table; found unless given, see `artifacts.find_artifact`.
            count: Number of gains per input, besides those of the states.

        Raises:
            ValueError: Another control period, or a table of another robot.
        """
        self.hold = hold_for(PERIOD, control_period, name)
        self.sizes = state_sizes(robot)
        arm = make_planar_arm(robot)
        path = find_artifact(robot, name) if gains is None else gains
        n, m = arm.inputs.shape
        table = load_gains(path, robot, name, m * (2 * n + count))
        self._law = reference(Law(arm, table, TendonMap(robot).input_scale))

    def _seen(self, observation: Observation) -> list[np.ndarray]:
        """What the policy reads, contiguous: a kernel would be compiled anew for other arrays."""
        return [np.ascontiguousarray(observation[name]) for name in self.requires]


def linear_model(
    arm: PlanarArm, curvature: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B and C of (6.25) to (6.27) for x = (curvatures, rates) and the tip (x, z).

    Args:
        arm: The arm.
        curvature: (n,) [1/m], at rest in equilibrium.
    """
    n = arm.n
    mass, gyroscopic, point, jacobian = np.empty((n, n)), np.empty(n), np.empty(2), np.empty((2, n))
    planar_arm.inertia_forces(arm, curvature, np.zeros(n), mass, gyroscopic)
    planar_arm.tip(arm, curvature, point, jacobian)
    inverse = np.linalg.inv(mass)
    stiffness = arm.stiffness * inverse
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -arm.damping_time * stiffness]])
    b = np.vstack([np.zeros_like(arm.inputs), inverse @ arm.inputs])
    return a, b, np.hstack([jacobian, np.zeros((2, n))])


def axes() -> list[np.ndarray]:
    """Values [1/m] along the three axes of the grid."""
    return [np.linspace(-limit, limit, count) for count, limit in GRID]


def operating_points(pieces: int) -> Iterator[np.ndarray]:
    """Curvatures (pieces,) [1/m] of all points, for thirds of pieces / 3 pieces each."""
    for sigma in product(*axes()):
        yield np.repeat(sigma, pieces // 3)


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
    shape, gains = tuple(count for count, _ in GRID), []
    for curvature in operating_points(robot.pieces):
        gains.append(design(curvature))
        progress(len(gains), int(np.prod(shape)))
    return np.reshape(gains, (*shape, -1))


def save_gains(path: Path, robot: RobotParams, gains: np.ndarray) -> None:
    """Write gains (n1, n2, n3, k), in single precision, which is far finer than they need be."""
    np.savez_compressed(path, gains=gains.astype(np.float32), robot=identity(robot))


def load_gains(path: Path, robot: RobotParams, policy: str, count: int) -> np.ndarray:
    """Gains (n1, n2, n3, count) that `save_gains` wrote.

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
    if wanted.shape != found.shape or not np.allclose(wanted, found, rtol=1e-9):
        refuse_artifact(path, ARM.name, robot, policy)
    data.check_shape("gains", (None,) * 4)
    gains = np.ascontiguousarray(data["gains"], dtype=np.float64)
    if gains.shape != (*(size for size, _ in GRID), count):
        raise ValueError(
            f"{path} does not fit this version: make it anew with `{train_command(robot, policy)}`"
        )
    return gains


@kernel
def interpolate(table: np.ndarray, curvature: np.ndarray, out: np.ndarray) -> bool:
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


@kernel
def conclude(
    wanted: np.ndarray,
    law: Law,
    gap: float,
    inside: bool,
    memory: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Action (n_inputs,), next memory (k,) and code of a decision.

    The action is NaN where it, or the memory, could not be computed; `Controller` then keeps both.

    Args:
        wanted: (n_inputs,) [N].
        law: Whose limits hold.
        gap: [m], from the operating point's tip to the reference.
        inside: Whether the operating point lies in the table's grid.
        memory: (k,), of this decision.
    """
    action = np.empty(len(wanted))
    saturated = limited(wanted, law.limit, action)
    if not (finite(wanted) and finite(memory)):
        return np.full(len(wanted), np.nan), memory, FINE
    if saturated:
        return action, memory, SATURATED
    if gap > REACH:
        return action, memory, UNREACHABLE
    return action, memory, FINE if inside else OUTSIDE
