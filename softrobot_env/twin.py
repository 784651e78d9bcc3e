"""`softrobot_env.robots.twin` under its public name."""

from softrobot_env.core.registry import served
from softrobot_env.robots.registry import CAMERA_PERIOD as FRAME
from softrobot_env.robots.registry import SERVO_SPEED
from softrobot_env.robots.twin import (
    ANISOTROPY,
    AZIMUTH_SPREAD,
    BACKLASH,
    CAMERA_NOISE,
    DAMPING_SPREAD,
    FRICTION,
    FRICTION_SPREAD,
    LARGEST_ERROR,
    LARGEST_NOISE,
    MODULUS,
    MODULUS_SPREAD,
    OFFSET,
    PRECURVATURE,
    RADIUS_SPREAD,
    TURN,
    TURN_SPREAD,
    Twin,
    nominal_twin,
    sampled_twin,
    twin_of,
)

__getattr__ = served("softrobot_env.robots.twin")

__all__ = [
    "ANISOTROPY",
    "AZIMUTH_SPREAD",
    "BACKLASH",
    "CAMERA_NOISE",
    "DAMPING_SPREAD",
    "FRAME",
    "FRICTION",
    "FRICTION_SPREAD",
    "LARGEST_ERROR",
    "LARGEST_NOISE",
    "MODULUS",
    "MODULUS_SPREAD",
    "OFFSET",
    "PRECURVATURE",
    "RADIUS_SPREAD",
    "SERVO_SPEED",
    "TURN",
    "TURN_SPREAD",
    "Twin",
    "nominal_twin",
    "sampled_twin",
    "twin_of",
]
