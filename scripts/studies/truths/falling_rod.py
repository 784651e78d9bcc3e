"""A clamped rod that falls from straight under its weight, by Ritz' method: no mesh, no chain.

The rod neither shears nor stretches and moves in the plane of gravity. Its section at s is turned
by t(s) towards gravity; the curvature t' is a sum of Legendre polynomials with coefficients q, so
the clamp is kept exactly, and errors fall exponentially with their number. With r' = (sin t,
cos t), gravity along the first axis, and a viscous moment in proportion to the elastic one,

    kinetic energy = 1/2 int (rho A |dr/dt|^2 + rho I (dt/dt)^2) ds,
    potential energy = 1/2 int EI t'^2 ds - int rho A g r_1 ds.
"""

import numpy as np
from numpy import ndarray
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp

from softrobot_env.robots import RobotParams

_NODES, _RTOL = 24, 1e-8


def falling_tips(robot: RobotParams, gravity: float, times: ndarray, terms: int = 6) -> ndarray:
    """Tips (k, 2) [m], in the direction of gravity and along the straight rod.

    Args:
        robot: A uniform rod; its own gravity plays no part.
        gravity: [m/s2], across the straight rod.
        times: (k,) [s], increasing from zero.
        terms: Number of polynomials.

    Raises:
        RuntimeError: The integration failed.
    """
    x, weights = legendre.leggauss(_NODES)
    weights = weights * robot.length / 2
    curvature = legendre.legvander(x, terms - 1)
    # From values at the nodes to integrals up to them, and up to the end.
    to_series = np.linalg.inv(legendre.legvander(x, _NODES - 1))
    series = legendre.legint(np.eye(_NODES), lbnd=-1)
    upto = robot.length / 2 * legendre.legval(np.append(x, 1.0), series).T @ to_series
    angle = (upto @ curvature)[:-1]
    mass = robot.mass_per_length * weights
    elastic = robot.bending_stiffness * curvature.T @ (weights[:, None] * curvature)
    rolling = robot.density * robot.second_moment * angle.T @ (weights[:, None] * angle)

    def slope(_: float, y: ndarray) -> ndarray:
        q, v = y[:terms], y[terms:]
        sin, cos = np.sin(angle @ q), np.cos(angle @ q)
        turning = (angle @ v) ** 2
        inertia, force = rolling.copy(), -elastic @ (q + robot.damping_time * v)
        for along, bent, pull in ((cos, -sin, gravity), (-sin, -cos, 0.0)):
            moves = (upto @ (along[:, None] * angle))[:-1]
            centripetal = (upto @ (bent * turning))[:-1]
            inertia += moves.T @ (mass[:, None] * moves)
            force += moves.T @ (mass * (pull - centripetal))
        return np.concatenate([v, np.linalg.solve(inertia, force)])

    about = (0, times[-1]), np.zeros(2 * terms), "Radau", times
    found = solve_ivp(slope, *about, rtol=_RTOL, atol=1e-3 * _RTOL)
    if not found.success:
        raise RuntimeError(f"the rod's motion failed: {found.message}")
    shape = angle @ found.y[:terms]
    return np.stack([weights @ np.sin(shape), weights @ np.cos(shape)], axis=1)
