"""Inverse dynamics of the spatial rig: servo constraints with one piece (thesis secs. 5.2.2, 5.3).

With one piece the rig is flat: its output z, the place of the head beside the axis, determines the
coordinates, and z, z' and z'' the forces. So no DAE is solved; that of `servo_dae`, (5.30) to
(5.33), has the same solution.

A drive that holds its input for a period lags by half of it, which is nearly all of the error of
held inputs: give it those for the middle of the period.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from softrobot_env.beams.closed_forms import spatial_piece
from softrobot_env.beams.closed_forms.spatial_piece import (
    SUBPIECES,
    RigPiece,
    add_dynamic,
    add_static,
    invert_output,
    make_rig_piece,
)
from softrobot_env.beams.numerics.compilation import kernel, reference, structure
from softrobot_env.beams.pcc import Station
from softrobot_env.robots import RobotParams
from softrobot_env.robots.three_tendons import Tripod


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
    """Data of the kernels: a rig and its tendons; see `RigPiece` and `Tripod`.

    Attributes:
        piece: `RigPiece`.
        limit, reach: Bending angle [rad] of the farthest output, and its distance [m].
        lever: [m].
        spread, null, arc, pretension, stiffness: As in `Tripod`.
    """

    piece: RigPiece
    limit: float
    reach: float
    lever: float
    spread: np.ndarray
    null: np.ndarray
    arc: np.ndarray
    pretension: np.ndarray
    stiffness: np.ndarray


class Inverse(NamedTuple):
    """Motion and inputs that put the output on references; arrays (n, ...) or, of one step, (...).

    Attributes:
        y, v, a: (n, 2) [rad, rad/s, rad/s2], coordinates of `RigPiece` and their derivatives.
        reduced: (n, 2) [N], F_red of `Tripod`; the effective tendon force (5.42).
        static: (n, 2) [N], its part that holds y at rest: elastic and gravity.
        tension: (n, 3) [N], least tensions that respect the pretension; the drive's limit does
            not enter.
        pulled: (n, 3) [m], lengths pulled in, s.
        dynamic: (n, 3) [m], its part s_dyn = C^-1 (F(reduced) - F(static)) of (5.36), which a
            quasi-static controller lacks.
    """

    y: np.ndarray
    v: np.ndarray
    a: np.ndarray
    reduced: np.ndarray
    static: np.ndarray
    tension: np.ndarray
    pulled: np.ndarray
    dynamic: np.ndarray


class ServoConstraints:
    """The inverse model of a rig.

    Attributes:
        robot: The rig.
        reach: [m], largest distance of the output from the axis.
        data: `Servo`, as a reference for kernels.
    """

    def __init__(self, robot: RobotParams, inertia: str | Sequence[Station] = SUBPIECES) -> None:
        """Build the model; arguments and errors are those of `make_rig_piece`."""
        self.robot = robot
        piece, tripod = make_rig_piece(robot, inertia), Tripod(robot)
        if not np.all(np.isfinite(tripod.stiffness)):
            raise ValueError(f"robot {robot.name!r}: tendons need a finite stiffness")
        limit, self.reach = spatial_piece.reach(piece)
        self.data = reference(
            Servo(
                piece=piece,
                limit=limit,
                reach=self.reach,
                lever=tripod.lever,
                spread=np.ascontiguousarray(tripod.spread),
                null=tripod.null,
                arc=tripod.arc,
                pretension=tripod.pretension,
                stiffness=tripod.stiffness,
            )
        )

    def plan(self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> Inverse:
        """The inverse along a trajectory.

        Args:
            position, velocity, acceleration: (n, 2) or (n, 3) [m, m/s, m/s2] of the output; a
                height is ignored, the rig has two degrees of freedom.

        Raises:
            OutOfReachError: A position is out of reach; the message says which.
            ValueError: Other shapes, or values that are not finite.
        """
        wanted = [np.asarray(x, dtype=float) for x in (position, velocity, acceleration)]
        shape = wanted[0].shape
        if len(shape) != 2 or shape[1] not in (2, 3) or any(x.shape != shape for x in wanted):
            raise ValueError(
                "position, velocity and acceleration need one shape, (n, 2) or (n, 3), got "
                f"{', '.join(str(x.shape) for x in wanted)}"
            )
        z, dz, ddz = (np.ascontiguousarray(x[:, :2]) for x in wanted)
        motion, inputs = np.empty((5, len(z), 2)), np.empty((3, len(z), 3))
        self._check(_plan(self.data, z, dz, ddz, motion, inputs), z)
        return Inverse(*motion, *inputs)

    def step(
        self,
        position: np.ndarray,
        velocity: np.ndarray,
        acceleration: np.ndarray,
        guess: np.ndarray | None = None,
    ) -> Inverse:
        """The inverse at one instant, for real time.

        Args:
            position, velocity, acceleration: (2,) or (3,) as in `plan`.
            guess: (2,) [rad], coordinates to start Newton's iteration from, such as the `y` of the
                step before.

        Raises:
            OutOfReachError: As `plan`.
            ValueError: As `plan`.
        """
        z, dz, ddz = (
            np.ascontiguousarray(x, dtype=float) for x in (position, velocity, acceleration)
        )
        if z.shape not in ((2,), (3,)) or dz.shape != z.shape or ddz.shape != z.shape:
            raise ValueError(
                "position, velocity and acceleration need one shape, (2,) or (3,), got "
                f"{z.shape}, {dz.shape}, {ddz.shape}"
            )
        motion, inputs = np.zeros((5, 2)), np.empty((3, 3))
        if guess is not None:
            motion[0] = guess
        if not _step(self.data, z, dz, ddz, motion, inputs):
            self._check(0, z[None])
        return Inverse(*motion, *inputs)

    def curvature(self, y: np.ndarray) -> np.ndarray:
        """Curvatures (..., 2) [1/m] towards x and y of coordinates (..., 2) [rad]."""
        return np.stack([y[..., 1], -y[..., 0]], axis=-1) / self.robot.length

    def _check(self, done: int, z: np.ndarray) -> None:
        """Raise an error unless all of the references (n, 2) were done."""
        if done == len(z):
            return
        distance = float(np.hypot(z[done, 0], z[done, 1]))
        if distance < self.reach or not np.isfinite(distance):
            raise ValueError(f"reference {done} is not finite")
        raise OutOfReachError(
            f"reference {done} is {1e3 * distance:.1f} mm from the axis of robot "
            f"{self.robot.name!r}, whose model reaches less than {1e3 * self.reach:.1f} mm",
            done,
        )


@kernel
def _least(servo: Servo, reduced: np.ndarray, out: np.ndarray) -> None:
    """Set out (3,) [N] to the tensions of `Tripod.tension` for a reduced input (2,) [N]."""
    shift = -np.inf
    for k in range(3):
        out[k] = servo.spread[k, 0] * reduced[0] + servo.spread[k, 1] * reduced[1]
        shift = max(shift, (servo.pretension[k] - out[k]) / servo.null[k])
    for k in range(3):
        out[k] += shift * servo.null[k]


@kernel
def reduce_force(servo: Servo, force: np.ndarray, out: np.ndarray) -> None:
    """Set out (2,) [N] to the reduced input that exerts a force (2,) [N m] on (mu, nu)."""
    out[0], out[1] = force[1] / servo.lever, -force[0] / servo.lever


@kernel
def inputs_of_motion(
    servo: Servo,
    y: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    reduced: np.ndarray,
    static: np.ndarray,
    inputs: np.ndarray,
) -> None:
    """Set the inputs that cause a motion, `Inverse.reduced`, `static`, and the rest (3, 3)."""
    force = np.zeros(2)
    add_static(servo.piece, y, force)
    reduce_force(servo, force, static)
    add_dynamic(servo.piece, y, v, a, force)
    reduce_force(servo, force, reduced)
    tension, pulled, dynamic = inputs[0], inputs[1], inputs[2]
    _least(servo, static, dynamic)
    _least(servo, reduced, tension)
    length = servo.piece.length
    for k in range(3):
        stiffness = servo.stiffness[k]
        geometric = (servo.arc[k, 0] * y[1] - servo.arc[k, 1] * y[0]) / length
        pulled[k] = geometric + (tension[k] - servo.pretension[k]) / stiffness
        dynamic[k] = (tension[k] - dynamic[k]) / stiffness


@kernel
def _step(
    servo: Servo,
    z: np.ndarray,
    dz: np.ndarray,
    ddz: np.ndarray,
    motion: np.ndarray,
    inputs: np.ndarray,
) -> bool:
    """Set motion (5, 2) and inputs (3, 3), the fields of `Inverse`; whether z is in reach.

    motion[0] is the guess of the coordinates.
    """
    total = dz[0] + dz[1] + ddz[0] + ddz[1]
    if not np.hypot(z[0], z[1]) < servo.reach or not np.isfinite(total):
        return False
    y, v, a = motion[0], motion[1], motion[2]
    invert_output(servo.piece, servo.limit, z, dz, ddz, y, v, a)
    inputs_of_motion(servo, y, v, a, motion[3], motion[4], inputs)
    return True


@kernel
def _plan(
    servo: Servo,
    z: np.ndarray,
    dz: np.ndarray,
    ddz: np.ndarray,
    motion: np.ndarray,
    inputs: np.ndarray,
) -> int:
    """Set motion (5, n, 2) and inputs (3, n, 3) for z, dz, ddz (n, 2); number of rows done."""
    now, pull = np.zeros((5, 2)), np.empty((3, 3))
    for i in range(len(z)):
        if not _step(servo, z[i], dz[i], ddz[i], now, pull):
            return i
        motion[:, i] = now
        inputs[:, i] = pull
    return len(z)
