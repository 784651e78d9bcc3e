"""The rig's inverse in several pieces along a whole trajectory, and its internal dynamics."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray
from scipy.linalg import null_space

from softrobot_env.beams.model import State
from softrobot_env.thesis.rig.servo_dae import output_matrix, place_output
from softrobot_env.thesis.rig.three_tendons import mean_curvature

_LEAD = 4  # steps in which errors of the first one, by the implicit Euler method, fade


class Plan(NamedTuple):
    """Motion and inputs that put the output on a trajectory.

    Attributes:
        time: (k,) [s].
        q, v: (k, n), curvatures (beta, gamma) of the pieces [1/m] and their rates.
        reduced: (k, 2) [N], F_red of `ThreeTendons`.
        tension: (k, 3) [N], least tensions that respect the pretension.
        pulled: (k, 3) [m], lengths pulled in.
    """

    time: ndarray
    q: ndarray
    v: ndarray
    reduced: ndarray
    tension: ndarray
    pulled: ndarray


def plan(servo, trajectory, times, substeps=1):
    """The inverse step by step along a trajectory, at equally spaced times (k,) [s].

    It begins four steps before the first instant, at rest or with the motion of least curvature
    rates that has the velocity wanted. Its error is of second order in the step; begun in motion,
    of first order at first.
    """
    h = (times[1] - times[0]) / substeps
    fine = times[0] + h * np.arange(-_LEAD, (len(times) - 1) * substeps + 1)
    z, dz = (f(fine)[:, :2] for f in (trajectory.position, trajectory.velocity))
    past = [servo.start(z[0])]
    past[0].v[2] = np.linalg.pinv(_output_matrix(servo, past[0].q[2])) @ dz[0]
    for place, velocity in zip(z[1:], dz[1:], strict=True):
        past.append(servo.step(past[-1], h, place, velocity))
    wanted = past[_LEAD::substeps]
    q, v = (np.array([getattr(one, name)[2] for one in wanted]) for name in ("q", "v"))
    reduced = np.array([one.reduced for one in wanted])
    tension, pulled = inputs(servo, q, reduced)
    return Plan(times, q, v, reduced, tension, pulled)


def inputs(servo, q, reduced):
    """Tensions and lengths pulled in (..., 3) for q (..., n) and reduced inputs (..., 2)."""
    tension = servo.tendons.tension(reduced)
    return tension, servo.tendons.pulled(tension, mean_curvature(q))


def output(servo, q):
    """Place (k, 2) [m] of the output beside the axis for curvatures (k, n) [1/m]."""
    out = np.empty((len(q), 2))
    for curvature, place in zip(np.ascontiguousarray(q), out, strict=True):
        place_output(servo.data, curvature, place)
    return out


def internal_poles(servo, q, reduced):
    """Poles (2 n - 4,) [1/s] of the internal dynamics at rest, slowest first.

    The transmission zeros from the reduced input to the output: the motions that the output does
    not show, M s^2 + D s + K on the null space of C along the range of B.

    Args:
        servo: `FlexibleServoConstraints`.
        q: (n,) [1/m] in equilibrium.
        reduced: (2,) [N] that hold it.
    """
    space = servo.model.linearize(State(q, np.zeros_like(q)), servo.tendons.tension(reduced))
    hidden, free = null_space(_output_matrix(servo, q)), null_space(servo.data.inputs.T)
    m, d, k = (free.T @ x @ hidden for x in (space.mass, space.damping, space.stiffness))
    lower = -np.linalg.solve(m, np.hstack([k, d]))
    poles = np.linalg.eigvals(np.vstack([np.eye(*lower.shape, len(m)), lower]))
    return poles[np.argsort(np.abs(poles))]


def _output_matrix(servo, q):
    outputs = np.empty((2, len(q)))
    output_matrix(servo.data, q, outputs)
    return outputs
