"""Statics of a planar tendon arm without gravity: constant curvature between tendon ends.

With continuous routing the tendon moment is constant between the stations where tendons end, so
the exact equilibrium of an inextensible, shear-free beam is piecewise constant in curvature
(audit of sec. 6.2.2: beta = sum F_k r_k / EI over the pairs that reach the piece). The tangent
angle phi(s) is then linear in the reduced inputs u, and tip and derivatives are integrals of
exp(i phi(s)), smooth through the straight pose.
"""

import numpy as np
from numpy import ndarray

from softrobot_env.robots import RobotParams, Tendon
from softrobot_env.robots.actuation import TendonMap

_NODES = 16


def channel_pairs(robot: RobotParams, what: str) -> tuple[TendonMap, list[Tendon]]:
    """Reduced inputs of a robot, and the first of each of its pairs of tendons.

    Raises:
        ValueError: The robot has gravity, guides, no tendons, or some without an opposite one.
    """
    if not robot.tendons or any(robot.gravity) or any(t.guides for t in robot.tendons):
        raise ValueError(
            f"robot {robot.name!r}: {what} needs tendons in continuous channels and no gravity"
        )
    tendon_map = TendonMap(robot)
    tendon_map.require_pairs(what)
    return tendon_map, [robot.tendons[np.flatnonzero(row)[0]] for row in tendon_map.phi]


class ConstantCurvatureStatics:
    """Tip (x, z) as a function of the reduced tendon inputs, and its derivatives."""

    def __init__(self, robot: RobotParams) -> None:
        """Errors as `channel_pairs`."""
        tendon_map, pairs = channel_pairs(robot, "the statics of constant curvature")
        self.robot = robot
        self.n_inputs, self.limit = tendon_map.n_inputs, tendon_map.input_scale
        # Curvature per input [1/(N m)] and end station [m] of every pair.
        self._sides = np.array([abs(t.offset[0]) for t in pairs]) / robot.bending_stiffness
        self._ends = np.array([t.end for t in pairs])
        stations, self._weights = self._quadrature()
        # phi(s) = slope(s) @ u: a pair bends the arm up to its end only.
        self._slope = self._sides * np.minimum.outer(stations, self._ends)

    def _quadrature(self) -> tuple[ndarray, ndarray]:
        """Gauss nodes and weights on each interval of constant curvature."""
        edges = np.unique(np.concatenate(([0.0], self._ends, [self.robot.length])))
        x, w = np.polynomial.legendre.leggauss(_NODES)
        size = np.diff(edges)[:, None]
        return (edges[:-1, None] + size * (x + 1) / 2).ravel(), (size * w / 2).ravel()

    def curvature(self, reduced: ndarray, stations: ndarray) -> ndarray:
        """Curvature (k,) [1/m] at arc lengths (k,) [m] under inputs (n_inputs,) [N]."""
        reached = np.less.outer(stations, self._ends)
        return (reached * self._sides) @ reduced

    def tip(self, reduced: ndarray) -> ndarray:
        """Tip (2,) [m] in (x, z) under reduced inputs (n_inputs,) [N]."""
        z = self._weights @ np.exp(1j * (self._slope @ reduced))
        return np.array([z.imag, z.real])

    def jacobian(self, reduced: ndarray) -> ndarray:
        """Derivative (2, n_inputs) [m/N] of the tip."""
        return self.expand(reduced)[1]

    def expand(self, reduced: ndarray) -> tuple[ndarray, ndarray, ndarray]:
        """Tip (2,), its first (2, n) and second (2, n, n) derivatives under inputs (n,) [N]."""
        e = self._weights * np.exp(1j * (self._slope @ reduced))
        first = 1j * (e @ self._slope)
        second = -(self._slope.T * e) @ self._slope
        tip = e.sum()
        return (
            np.array([tip.imag, tip.real]),
            np.stack([first.imag, first.real]),
            np.stack([second.imag, second.real]),
        )
