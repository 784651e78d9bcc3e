"""What an agent of the test rig can observe, in SI units, with finite bounds."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from gymnasium import spaces

from softrobot_env.envs.observations.arm import REFERENCE_SPEED, positions, symmetric, tensions
from softrobot_env.robots import RobotParams
from softrobot_env.robots.twin import LARGEST_ERROR, LARGEST_NOISE
from softrobot_env.scene.quadrature import HingeLayout

#: Largest reference acceleration an environment accepts, in robot lengths per second squared.
REFERENCE_ACCELERATION = 1000.0

#: Standard deviations at which the camera's noise ends, so that it has bounds.
FARTHEST = 6.0


@dataclass(frozen=True)
class RigSizes:
    """What the shapes and bounds of observables depend on.

    Attributes:
        robot: The simulated robot.
        layout: Its hinges.
        n_preview: Number of preview times.
        length_scale: [m], pulled in by a full-scale action.
    """

    robot: RobotParams
    layout: HingeLayout
    n_preview: int
    length_scale: float

    @property
    def n_tendons(self) -> int:
        """Number of tendons, and of actions."""
        return len(self.robot.tendons)

    @property
    def turning_rate(self) -> float:
        """Sum of the hinge rates [rad/s] beyond which MuJoCo itself reports a divergence."""
        return 2 * mujoco.mjMAXVAL * len(self.layout.stations)


def _seen_position(sizes: RigSizes) -> spaces.Box:
    room = FARTHEST * LARGEST_NOISE
    box = positions(2, sizes.robot)
    return spaces.Box(box.low - room, box.high + room, dtype=np.float64)


#: Space of every observable; positions are (x, y), curvatures (beta, gamma) piece by piece.
RIG_OBSERVABLES: dict[str, Callable[[RigSizes], spaces.Box]] = {
    "tip_position": _seen_position,
    "tip_velocity": lambda s: symmetric(2, s.turning_rate * s.robot.reach),
    "curvature": lambda s: symmetric(2 * s.robot.pieces, s.robot.curvature_limit),
    "curvature_rate": lambda s: symmetric(
        2 * s.robot.pieces, s.turning_rate * s.robot.pieces / s.robot.length
    ),
    "tendon_length": lambda s: symmetric(s.n_tendons, s.length_scale + LARGEST_ERROR),
    "tendon_tension": tensions,
    "reference": lambda s: positions(2, s.robot),
    "reference_velocity": lambda s: symmetric(2, REFERENCE_SPEED * s.robot.reach),
    "reference_acceleration": lambda s: symmetric(2, REFERENCE_ACCELERATION * s.robot.reach),
    "reference_preview": lambda s: positions(2 * s.n_preview, s.robot),
    "previous_action": lambda s: symmetric(s.n_tendons, 1.0),
}

#: What agents see unless they choose: what the real rig has, camera and servos, and the reference.
DEFAULT_RIG_OBSERVABLES = (
    "tip_position",
    "tip_velocity",
    "tendon_length",
    "reference",
    "reference_velocity",
    "reference_acceleration",
    "reference_preview",
    "previous_action",
)
