"""Elements of the absolute nodal coordinate formulation."""

from softrobot_env.beams.ancf.model import ANCF, PLANES

__all__ = ["ANCF", "PLANES"]
