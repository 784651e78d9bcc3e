"""Inverse dynamics of the spatial rig: servo constraints with one piece (thesis secs. 5.2.2, 5.3).

With one piece the rig is flat: its output z, the place of the head beside the axis, determines the
coordinates, and z, z' and z'' the forces. So no DAE is solved; that of `servo_dae`, (5.30) to
(5.33), has the same solution.

A drive that holds its input for a period lags by half of it, which is nearly all of the error of
held inputs: give it those for the middle of the period.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, reference, structure
from softrobot_env.robots import RobotParams

from .spatial_piece import (
    RigPiece,
    add_dynamic,
    add_static,
    invert_output,
    make_rig_piece,
    reach,
)
from .three_tendons import elastic_tendons


class OutOfReachError(ValueError):
    """The rig cannot put its output on a reference.

    Attributes:
        index: Row of the first such reference.
    """

    def __init__(self, message: str, index: int) -> None:
        super().__init__(message)
        self.index = index


@structure
class Servo(NamedTuple):
    """Data of the kernel.

    Attributes:
        piece: `RigPiece`.
        limit, reach: Bending angle [rad] of the farthest output, and its distance [m].
        moment_arm: [m], of `ThreeTendons`.
    """

    piece: RigPiece
    limit: float
    reach: float
    moment_arm: float


class ServoConstraints:
    """The inverse model of a rig.

    Attributes:
        robot: The rig.
        tendons: Its tendons.
        reach: [m], largest distance of the output from the axis.
        data: `Servo`, as a reference for kernels.
    """

    def __init__(self, robot: RobotParams) -> None:
        """Build the model; arguments and errors are those of `make_rig_piece`."""
        self.robot, self.tendons = robot, elastic_tendons(robot)
        piece = make_rig_piece(robot)
        limit, self.reach = reach(piece)
        self.data = reference(Servo(piece, limit, self.reach, self.tendons.moment_arm))

    def curvature(self, y: ndarray) -> ndarray:
        """Curvatures (..., 2) [1/m] towards x and y of coordinates (..., 2) [rad]."""
        return np.stack([y[..., 1], -y[..., 0]], axis=-1) / self.robot.length

    def motion(
        self, z: ndarray, dz: ndarray, ddz: ndarray, guess: ndarray | None = None
    ) -> ndarray:
        """Motion and inputs (5, n, 2) that put the output on references.

        They are the coordinates of `RigPiece` [rad] with their first and second derivatives, the
        effective tendon force (5.42), F_red of `ThreeTendons` [N], and its part that holds the
        coordinates at rest: elastic and gravity.

        Args:
            z, dz, ddz: (n, 2) or (n, 3) [m, m/s, m/s2] of the output, contiguous; a height is
                ignored, the rig has two degrees of freedom.
            guess: (2,) [rad], where Newton's iteration starts for the first reference, as of the
                step before; each solution is the guess of the next one.

        Raises:
            OutOfReachError: A position is out of reach; the message says which.
            ValueError: One is not finite.
        """
        motion = np.zeros((5, len(z), 2))
        if guess is not None:
            motion[0, 0] = guess
        done = _solve(self.data, z, dz, ddz, motion)
        if done == len(z):
            return motion
        distance = float(np.hypot(z[done, 0], z[done, 1]))
        if distance < self.reach or not np.isfinite(distance):
            raise ValueError(f"reference {done} is not finite")
        raise OutOfReachError(
            f"reference {done} is {1e3 * distance:.1f} mm from the axis of robot "
            f"{self.robot.name!r}, whose model reaches less than {1e3 * self.reach:.1f} mm",
            done,
        )


@kernel
def _solve(servo: Servo, z: ndarray, dz: ndarray, ddz: ndarray, motion: ndarray) -> int:
    """Set motion (5, n, 2), see `ServoConstraints.motion`; number of references done.

    motion[0, 0] is the guess of the first coordinates, each reference that of the next.
    """
    before, force = motion[0, 0], np.empty(2)
    for i in range(len(z)):
        total = dz[i, 0] + dz[i, 1] + ddz[i, 0] + ddz[i, 1]
        if not np.hypot(z[i, 0], z[i, 1]) < servo.reach or not np.isfinite(total):
            return i
        y, v, a = motion[0, i], motion[1, i], motion[2, i]
        y[:] = before
        invert_output(servo.piece, servo.limit, z[i], dz[i], ddz[i], y, v, a)
        force[:] = 0
        add_static(servo.piece, y, force)
        _reduce(servo, force, motion[4, i])
        add_dynamic(servo.piece, y, v, a, force)
        _reduce(servo, force, motion[3, i])
        before = y
    return len(z)


@kernel
def _reduce(servo: Servo, force: ndarray, out: ndarray) -> None:
    """Set out (2,) [N] to the reduced input that exerts a force (2,) [N m] on (mu, nu)."""
    out[0], out[1] = force[1] / servo.moment_arm, -force[0] / servo.moment_arm
