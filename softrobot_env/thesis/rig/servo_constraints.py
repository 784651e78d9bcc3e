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

from softrobot_env.beams.numerics.compilation import kernel, reference, structure
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
        lever: [m], of `ThreeTendons`.
    """

    piece: RigPiece
    limit: float
    reach: float
    lever: float


class Inverse(NamedTuple):
    """Motion and inputs that put the output on references.

    Attributes:
        y, v, a: (n, 2) [rad, rad/s, rad/s2], coordinates of `RigPiece` and their derivatives.
        reduced: (n, 2) [N], F_red of `ThreeTendons`; the effective tendon force (5.42).
        static: (n, 2) [N], its part that holds y at rest: elastic and gravity.
        tension: (n, 3) [N], least tensions that respect the pretension; the drive's limit does
            not enter.
        pulled: (n, 3) [m], lengths pulled in, s.
        dynamic: (n, 3) [m], its part s_dyn = C^-1 (F(reduced) - F(static)) of (5.36), which a
            quasi-static controller lacks.
    """

    y: ndarray
    v: ndarray
    a: ndarray
    reduced: ndarray
    static: ndarray
    tension: ndarray
    pulled: ndarray
    dynamic: ndarray


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
        self.data = reference(Servo(piece, limit, self.reach, self.tendons.lever))

    def plan(self, position: ndarray, velocity: ndarray, acceleration: ndarray) -> Inverse:
        """The inverse along a trajectory.

        Args:
            position, velocity, acceleration: (n, 2) or (n, 3) [m, m/s, m/s2] of the output; a
                height is ignored, the rig has two degrees of freedom.

        Raises:
            OutOfReachError: A position is out of reach; the message says which.
            ValueError: Other shapes, or values that are not finite.
        """
        wanted = [np.ascontiguousarray(x, float) for x in (position, velocity, acceleration)]
        shape = wanted[0].shape
        if len(shape) != 2 or shape[1] not in (2, 3) or any(x.shape != shape for x in wanted):
            raise ValueError(
                "position, velocity and acceleration need one shape, (n, 2) or (n, 3), got "
                f"{', '.join(str(x.shape) for x in wanted)}"
            )
        motion = self.motion(*wanted)
        y, _, _, reduced, static = motion
        tension = self.tendons.tension(reduced)
        pulled = self.tendons.pulled(tension, self.curvature(y))
        dynamic = (tension - self.tendons.tension(static)) / self.tendons.stiffness
        return Inverse(*motion, tension, pulled, dynamic)

    def curvature(self, y: ndarray) -> ndarray:
        """Curvatures (..., 2) [1/m] towards x and y of coordinates (..., 2) [rad]."""
        return np.stack([y[..., 1], -y[..., 0]], axis=-1) / self.robot.length

    def motion(
        self, z: ndarray, dz: ndarray, ddz: ndarray, guess: ndarray | None = None
    ) -> ndarray:
        """Of `Inverse` the first five fields alone (5, n, 2); arguments and errors as `plan`.

        Not checked are the arguments' shapes. Newton's iteration starts from a guess (2,) [rad] of
        the first coordinates, as of the step before; each solution is the guess of the next ones.
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
    """Set motion (5, n, 2), the first five fields of `Inverse`; number of references done.

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
    out[0], out[1] = force[1] / servo.lever, -force[0] / servo.lever
