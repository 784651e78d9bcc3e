"""Derivatives of simulated motions and equilibria: of what the integrator computes, exactly.

`Rollout` simulates a scene or an environment and derives what is observed of the motion, backwards
(`Motion.vjp`) or along a change (`Motion.jvp`); `BeamRest` derives equilibria of beam models.
`wrappers` has functions for PyTorch and JAX.
Nothing of this is loaded or compiled by environments.
"""

from .beams import BeamRest
from .motions import Derivatives, Motion, Observed, Rest
from .parameters import Parameter
from .rollout import Rollout
from .threads import on_threads

__all__ = [
    "BeamRest",
    "Derivatives",
    "Motion",
    "Observed",
    "Parameter",
    "Rest",
    "Rollout",
    "on_threads",
]
