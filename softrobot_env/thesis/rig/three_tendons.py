"""Three tendons round a robot that bends in space: reduced inputs, tensions and pulled-in lengths.

Thesis sec. 3.1.2 with the audit's corrections of (3.3) to (3.5) and (5.19) to (5.23).
"""

import numpy as np
from numpy import ndarray

from softrobot_env.robots.parameters import Head, RobotParams, Tendon


class ThreeTendons:
    """Maps between reduced inputs, tensions and pulled-in lengths of three tendons.

    The reduced input F_red = Phi F [N] is the pull of the tendons projected on x and y, (3.1): the
    columns of Phi are the tendons' offsets over their mean distance from the fibre, `moment_arm`,
    so that moment_arm * F_red is the bending moment towards x and y [N m], wherever the tendons
    lie.

    Attributes:
        phi: (2, 3) [1].
        moment_arm: [m].
        spread: (3, 2), pseudo-inverse of phi.
        null: (3,), positive tensions [1] that cancel each other, 1 on average: phi @ null = 0.
        arc: (3, 2) [m2], lengths pulled in per curvature towards x and y.
        pretension, stiffness: (3,) [N, N/m].
    """

    def __init__(self, robot: RobotParams) -> None:
        """Raise ValueError unless three straight channels of one length surround the fibre."""
        tendons = robot.tendons
        _check(robot, tendons)
        offsets = robot.of_tendons("offset")
        self.moment_arm = float(np.mean(np.hypot(*offsets.T)))
        self.phi = offsets.T / self.moment_arm
        self.spread = np.linalg.pinv(self.phi)
        self.null = _cancelling(robot, self.phi)
        self.arc = offsets * tendons[0].end
        self.pretension = robot.of_tendons("pretension")
        self.stiffness = robot.of_tendons("stiffness")

    def tension(self, reduced: ndarray, total: float | None = None) -> ndarray:
        """Tensions (..., 3) [N] that give reduced inputs (..., 2) [N].

        The tensions of least norm, shifted along `null`: F = F~ - min F~ + F_pre for tendons at
        120 degrees, F~ = 2/3 Phi^T F_red. They are continuous in the reduced input.

        Args:
            reduced: Reduced inputs.
            total: Sum of the tensions [N]; unless given, the least tensions that respect the
                pretension.

        Raises:
            ValueError: The sum is too small to respect the pretension.
        """
        if total is None:
            least = np.asarray(reduced) @ self.spread.T
            shift = np.max((self.pretension - least) / self.null, axis=-1)
            return least + shift[..., None] * self.null
        tension = self.with_total(reduced, total)
        missing = np.max(self.pretension - tension)
        if missing > 1e-12 * max(1.0, abs(total)):
            needed = np.max(self.tension(reduced).sum(axis=-1))
            raise ValueError(
                f"a sum of {total:g} N leaves a tendon {missing:.3g} N below its pretension; "
                f"give at least {needed:.6g} N"
            )
        return tension

    def with_total(self, reduced: ndarray, total: float) -> ndarray:
        """Tensions (..., 3) [N] of a given sum [N], also where it leaves one little or none.

        Linear in the reduced input (..., 2) [N], hence without the kinks of the least tensions.
        """
        least = np.asarray(reduced) @ self.spread.T
        shift = (total - least.sum(axis=-1)) / self.null.sum()
        return least + shift[..., None] * self.null

    def pulled(self, tension: ndarray, curvature: ndarray) -> ndarray:
        """Lengths pulled in (..., 3) [m]: s = s_geo + (F - F_pre) / c, audit of (5.35).

        Args:
            tension: (..., 3) [N].
            curvature: (..., 2) [1/m], mean over the tendons' length, towards x and y.
        """
        stretch = (np.asarray(tension) - self.pretension) / self.stiffness
        return self.geometric(curvature) + stretch

    def geometric(self, curvature: ndarray) -> ndarray:
        """s_geo (..., 3) [m]: how much shorter the channels are than in the straight robot."""
        return np.asarray(curvature) @ self.arc.T


def elastic_tendons(robot: RobotParams) -> ThreeTendons:
    """Tendons that lengths can drive; ValueError as of `ThreeTendons`, or if one does not give."""
    tendons = ThreeTendons(robot)
    if not np.all(np.isfinite(tendons.stiffness)):
        raise ValueError(f"robot {robot.name!r}: tendons need a finite stiffness")
    return tendons


def head_of(robot: RobotParams) -> Head:
    """The head, whose output a rig moves; ValueError if there is none."""
    if robot.head is None:
        raise ValueError(f"robot {robot.name!r}: a rig needs a head, whose output it moves")
    return robot.head


def is_rig(robot: RobotParams) -> bool:
    """Whether the thesis' closed form of one piece knows a robot: a head, three tendons."""
    try:
        elastic_tendons(robot)
    except ValueError:
        return False
    return robot.head is not None and robot.is_symmetric


def mean_curvature(q: ndarray) -> ndarray:
    """Mean (..., 2) [1/m] towards x and y over equal pieces, of their curvatures (..., n)."""
    return q.reshape(*q.shape[:-1], -1, 2).mean(axis=-2)


def _check(robot: RobotParams, tendons: tuple[Tendon, ...]) -> None:
    straight = all(t.is_straight and not t.guides for t in tendons)
    if len(tendons) != 3 or not straight or len({t.end for t in tendons}) > 1:
        raise ValueError(
            f"robot {robot.name!r}: need three tendons in straight channels of one length, got "
            f"{', '.join(t.name for t in tendons) or 'none'}"
        )


def _cancelling(robot: RobotParams, phi: ndarray) -> ndarray:
    """Tensions (3,), 1 on average, that phi (2, 3) maps to zero."""
    null = np.cross(phi[0], phi[1])
    size = np.max(np.abs(null))
    if size < 1e-9 or not (np.all(null > 1e-9 * size) or np.all(null < -1e-9 * size)):
        places = [t.offset for t in robot.tendons]
        raise ValueError(f"robot {robot.name!r}: tendons at {places} m do not surround the fibre")
    return null / np.mean(null)
