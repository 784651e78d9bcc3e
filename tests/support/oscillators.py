"""A chain of masses and cubic springs as the simplest model the beam kernels can run."""

import sys
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.beams import mechanics
from softrobot_env.beams.actuation import Actuation, points_only
from softrobot_env.beams.numerics.compilation import kernel, reference, structure


@structure
class ChainData(NamedTuple):
    """n masses in a row, the first one tied to a wall."""

    n: int
    block: int
    reach: int
    scale: ndarray
    actuation: Actuation
    stiffness: ndarray
    damping: float
    cubic: float
    gravity: ndarray


def chain(stiffness, damping=0.0, cubic=0.0, pull=0.0):
    n = len(stiffness)
    data = ChainData(
        n,
        1,
        1,
        np.ones(n),
        points_only(np.empty(0)),
        np.array(stiffness, dtype=float),
        damping,
        cubic,
        np.full(n, pull),
    )
    return reference(data)


@kernel
def internal_residual(model, q, v, a, out):
    for i in range(model.n):
        out[i] = a[i] - model.gravity[i]
    for i in range(model.n):
        stretch, rate = q[i], v[i]
        if i > 0:
            stretch, rate = stretch - q[i - 1], rate - v[i - 1]
        force = model.stiffness[i] * (stretch + model.damping * rate) + model.cubic * stretch**3
        out[i] += force
        if i > 0:
            out[i - 1] -= force


@kernel
def solve_mass(model, q, force, out):
    for i in range(model.n):
        out[i] = force[i]


@kernel
def nothing(model, q, out):
    pass


@kernel
def no_forces(model, q, forces, out):
    pass


@kernel
def add_wrenches(model, q, forces, moments, out):
    pass


project = locate = load_axes = channel_lengths = nothing
add_channel_forces = no_forces

mechanics.implement(ChainData, sys.modules[__name__])
