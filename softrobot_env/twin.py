"""`softrobot_env.robots.twin` under its public name."""

from softrobot_env.robots.twin import (
    FRAME,
    LARGEST_ERROR,
    LARGEST_NOISE,
    SERVO_SPEED,
    Twin,
    nominal_twin,
    rig3d_twin,
    twin_or_ideal,
)

__all__ = [
    "FRAME",
    "LARGEST_ERROR",
    "LARGEST_NOISE",
    "SERVO_SPEED",
    "Twin",
    "nominal_twin",
    "rig3d_twin",
    "twin_or_ideal",
]
