"""What an agent can observe: one named quantity per key, in SI units, with finite bounds."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from gymnasium import spaces

from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.quadrature import HingeLayout

#: Fastest reference an environment accepts, in robot lengths per second.
REFERENCE_SPEED = 10.0


@dataclass(frozen=True)
class Sizes:
    """What the shapes and bounds of observables depend on."""

    robot: RobotParams
    tendon_map: TendonMap
    layout: HingeLayout
    n_preview: int

    @property
    def n_pieces(self) -> int:
        """Number of pieces."""
        return self.layout.pieces

    @property
    def turning_rate(self) -> float:
        """Sum of the hinge rates [rad/s] beyond which MuJoCo itself reports a divergence."""
        return mujoco.mjMAXVAL * len(self.layout.stations)


def symmetric(size: int, bound: float | np.ndarray) -> spaces.Box:
    """Box (size,) of float64 between -bound and bound."""
    high = np.broadcast_to(np.asarray(bound, dtype=np.float64), (size,))
    return spaces.Box(-high, high, dtype=np.float64)


def positions(size: int, robot: RobotParams) -> spaces.Box:
    """Coordinates [m] of points within the robot's reach."""
    # The margin covers the rounding of a straight robot's tip.
    return symmetric(size, robot.reach * (1 + 1e-9))


def _tendon_length(sizes: Sizes) -> spaces.Box:
    ends = np.array([t.end for t in sizes.robot.tendons])
    radius = np.array([np.hypot(*t.offset) for t in sizes.robot.tendons])
    change = ends * radius * sizes.robot.curvature_limit
    return spaces.Box(ends - change, ends + change, dtype=np.float64)


def tensions(sizes: Any) -> spaces.Box:
    """Tensions [N] of the tendons of `sizes.robot`, up to their limits."""
    limit = np.array([t.tension_limit for t in sizes.robot.tendons])
    return spaces.Box(np.zeros_like(limit), limit * (1 + 1e-9), dtype=np.float64)


#: Space of every observable. In a planar robot positions are (x, z).
OBSERVABLES: dict[str, Callable[[Sizes], spaces.Box]] = {
    "tip_position": lambda s: positions(2, s.robot),
    "tip_velocity": lambda s: symmetric(2, s.turning_rate * s.robot.length),
    "curvature": lambda s: symmetric(s.n_pieces, s.robot.curvature_limit),
    "curvature_rate": lambda s: symmetric(s.n_pieces, s.turning_rate / s.layout.piece_length),
    "tendon_tension": tensions,
    "tendon_length": _tendon_length,
    "reference": lambda s: positions(2, s.robot),
    "reference_velocity": lambda s: symmetric(2, REFERENCE_SPEED * s.robot.length),
    "reference_preview": lambda s: positions(2 * s.n_preview, s.robot),
    "previous_action": lambda s: symmetric(s.tendon_map.n_inputs, 1.0),
}

#: What agents see unless they choose.
DEFAULT_OBSERVABLES = (
    "tip_position",
    "tip_velocity",
    "curvature",
    "curvature_rate",
    "reference",
    "reference_velocity",
    "reference_preview",
    "previous_action",
)


def observation_space(
    names: tuple[str, ...],
    sizes: Any,
    observables: dict[str, Callable[[Any], spaces.Box]] = OBSERVABLES,
) -> spaces.Dict:
    """Dict space of the named ones of an environment's `observables`.

    Raises:
        ValueError: No name, an unknown name or a repeated one.
    """
    unknown = [n for n in names if n not in observables]
    if unknown or not names or len(set(names)) < len(names):
        raise ValueError(
            f"observe needs distinct names out of {', '.join(observables)}; got {list(names)}"
        )
    return spaces.Dict({name: observables[name](sizes) for name in names})
