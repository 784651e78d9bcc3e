"""Piecewise constant curvature."""

from softrobot_env.beams.pcc.model import AXES, INERTIAS, PCC, Station

__all__ = ["AXES", "INERTIAS", "PCC", "Station"]
