"""Elements of the absolute nodal coordinate formulation."""

from softrobot_env.beams.ancf.model import ANCF, PLANES, LockingWarning

__all__ = ["ANCF", "PLANES", "LockingWarning"]
