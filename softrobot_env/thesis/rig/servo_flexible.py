"""Inverse dynamics of the spatial rig with any number of pieces: the DAE of the servo constraints.

(5.30) to (5.33) with the audit's corrections, solved forward in time by the two-step BDF method.
With more than one piece the output does not determine the motion: internal dynamics are left.
Forward integration is right where they are stable, as they are with the rig's damping up to 130 mm
from the axis; with next to none, far bends are not minimum phase. Large steps damp the fast
internal motions, growing ones as well, and so treat them as quasi-static.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.beams.model import IntegrationError
from softrobot_env.beams.pcc import PCC
from softrobot_env.compile.kernels import reference
from softrobot_env.robots import RobotParams

from .servo_dae import FlexibleRig, advance, hold
from .spatial_piece import SUBPIECES
from .three_tendons import ThreeTendons, head_of

_STATIC_STEP = 0.01  # m, of the output when its statics are followed
#: Rate [1/s] at which an error of the output decays (Baumgarte): without it z drifts.
STABILISATION = 50.0


class InversionError(IntegrationError):
    """Newton's iteration failed: the output cannot follow, or the step is too large."""


class Progress(NamedTuple):
    """Where an inversion step by step stands.

    Attributes:
        q, v: (3, n), the last states, newest last.
        reduced: (2,) [N].
        steps: Steps taken.
    """

    q: ndarray
    v: ndarray
    reduced: ndarray
    steps: int


class FlexibleServoConstraints:
    """The inverse model of a rig in several pieces.

    Attributes:
        robot: The rig.
        model: `PCC` of the rig, driven by tension.
        tendons: Its tendons.
        data: `FlexibleRig`, as a reference for kernels.
    """

    def __init__(self, robot: RobotParams, pieces: int) -> None:
        """Build the model.

        Args:
            robot: With three tendons in channels up to its tip, and a head.
            pieces: Number of equal pieces.

        Raises:
            ValueError: Other tendons, no head, or what `PCC` refuses.
        """
        head = head_of(robot)
        robot.require_uniform("a model of the rig by equal pieces")
        ends = robot.of_tendons("end")
        # So each piece bends under the moment of all tendons.
        if not np.allclose(ends, robot.length, rtol=1e-12, atol=0):
            raise ValueError(
                f"robot {robot.name!r}: tendons must end at its tip, at {robot.length} m, got ends "
                f"{', '.join(f'{end:g}' for end in ends)} m"
            )
        self.robot, self.tendons = robot, ThreeTendons(robot)
        self.model = PCC(robot, pieces, axes="spatial", inertia=SUBPIECES)
        # Each piece of length l bends under the whole moment, moment_arm * F_red.
        moment = robot.length / self.model.pieces * self.tendons.moment_arm * np.eye(2)
        self.data = reference(
            FlexibleRig(
                model=self.model.data,
                probe=self.model.probe(np.array([robot.length])),
                height=head.output,
                inputs=np.tile(moment, (self.model.pieces, 1)),
            )
        )

    def statics(self, position: ndarray) -> tuple[ndarray, ndarray]:
        """Curvatures (n,) [1/m] and reduced input (2,) [N] that hold the output at (2,) [m].

        Raises:
            InversionError: It is out of reach.
        """
        q, reduced = self.model.rest(), np.zeros(2)
        position = np.asarray(position, float)
        count = 1 + int(np.hypot(*position) / _STATIC_STEP)
        for share in np.linspace(0, 1, count + 1)[1:]:
            if not hold(self.data, share * position, q, reduced):
                raise InversionError(
                    f"the output of robot {self.robot.name!r} cannot be held at {position} m", 0.0
                )
        return q, reduced

    def start(self, position: ndarray) -> Progress:
        """Begin step by step, at rest with the output at (2,) or (3,) [m].

        Raises:
            InversionError: The output cannot be held there.
        """
        past = np.zeros((2, 3, self.model.n))
        past[0, 2], reduced = self.statics(np.asarray(position, float)[:2])
        return Progress(*past, reduced, 0)

    def step(
        self,
        progress: Progress,
        period: float,
        position: ndarray,
        velocity: ndarray,
    ) -> Progress:
        """Go on by a period [s], the same in all steps, for real time.

        Args:
            progress: Where the inversion stands; not changed.
            period: Step.
            position, velocity: (2,) or (3,) [m, m/s], where the output should be after it.

        Raises:
            InversionError: The iteration failed; the message says when.
        """
        z, dz = (np.asarray(x, float)[:2].copy() for x in (position, velocity))
        q, v, reduced = progress.q.copy(), progress.v.copy(), progress.reduced.copy()
        first, steps = progress.steps == 0, progress.steps + 1
        if not advance(self.data, period, STABILISATION, first, z, dz, q, v, reduced):
            time = steps * period
            raise InversionError(
                f"Newton's iteration failed at t = {time:.4g} s, with the output at "
                f"{1e3 * np.hypot(*z):.1f} mm from the axis; take smaller steps or a reference in "
                "reach",
                time,
            )
        return Progress(q, v, reduced, steps)
