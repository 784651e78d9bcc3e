"""Piecewise constant curvature."""

from .model import AXES, INERTIAS, PCC, Station

__all__ = ["AXES", "INERTIAS", "PCC", "Station"]
