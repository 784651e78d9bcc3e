"""Elements of the absolute nodal coordinate formulation."""

from .model import ANCF, PLANES, LockingWarning

__all__ = ["ANCF", "PLANES", "LockingWarning"]
