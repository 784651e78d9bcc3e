"""Spectral submanifold reduction: models of few coordinates, learned from measured motion.

Thesis sec. 3.3, after Haller and Ponsioen, Nonlinear Dyn. 86 (2016) 1493-1534, and Cenedese et al.,
Nat. Commun. 13 (2022) 872. Measured outputs, with some of their past, are a point near a manifold
of few coordinates x; polynomials tell where it is, w(x), and how x moves, r(x, u). Where inputs u
are not small, r has products of x and u too, so that every equilibrium has dynamics of its own
(Haller and Kaundinya, Chaos 34 (2024) 043152).
"""

from .analysis import NormalForm, Spectrum, normal_form, spectrum
from .fitting import THESIS, FitError, Settings, check_stable, fit
from .model import ReducedModel
from .records import Record
from .refinement import Refinement, refine

__all__ = [
    "THESIS",
    "FitError",
    "NormalForm",
    "Record",
    "ReducedModel",
    "Refinement",
    "Settings",
    "Spectrum",
    "check_stable",
    "fit",
    "normal_form",
    "refine",
    "spectrum",
]
