"""Piecewise constant curvature."""

from softrobot_env.beams.pcc.model import PCC, Station

__all__ = ["PCC", "Station"]
