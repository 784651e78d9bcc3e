"""Statics of a planar tendon arm without gravity: constant curvature between tendon ends.

With continuous routing the tendon moment is constant between the stations where tendons end, so
the exact equilibrium of an inextensible, shear-free beam is piecewise constant in curvature
(audit of sec. 6.2.2: beta = sum F_k r_k / EI over the pairs that reach the piece). The tangent
angle phi(s) is then linear in the reduced inputs u, and tip and derivatives are integrals of
exp(i phi(s)), smooth through the straight pose.
"""

import numpy as np

from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap

_NODES = 16


class ConstantCurvatureStatics:
    """Tip (x, z) as a function of the reduced tendon inputs, and its derivatives."""

    def __init__(self, robot: RobotParams) -> None:
        """Raise ValueError when the robot has gravity, guides or no tendons."""
        if not robot.tendons or any(robot.gravity) or any(t.guides for t in robot.tendons):
            raise ValueError(
                f"robot {robot.name!r}: constant-curvature statics need tendons in continuous "
                "channels and no gravity"
            )
        self.robot = robot
        tendon_map = TendonMap(robot)
        tendon_map.require_pairs("constant-curvature statics")
        self.n_inputs = tendon_map.n_inputs
        self.limit = tendon_map.input_scale
        self._sides, self._ends = self._pairs(tendon_map)
        stations, self._weights = self._quadrature()
        # phi(s) = slope(s) @ u: a pair bends the arm up to its end only.
        self._slope = self._sides * np.minimum.outer(stations, self._ends)

    def _pairs(self, tendon_map: TendonMap) -> tuple[np.ndarray, np.ndarray]:
        """Curvature per input [1/(N m)] and end station [m] of every pair."""
        tendons = self.robot.tendons
        members = [np.flatnonzero(row) for row in tendon_map.phi]
        radius = np.array([abs(tendons[m[0]].offset[0]) for m in members])
        return radius / self.robot.bending_stiffness, np.array([tendons[m[0]].end for m in members])

    def _quadrature(self) -> tuple[np.ndarray, np.ndarray]:
        """Gauss nodes and weights on each interval of constant curvature."""
        edges = np.unique(np.concatenate(([0.0], self._ends, [self.robot.length])))
        x, w = np.polynomial.legendre.leggauss(_NODES)
        size = np.diff(edges)[:, None]
        return (edges[:-1, None] + size * (x + 1) / 2).ravel(), (size * w / 2).ravel()

    def curvature(self, reduced: np.ndarray, stations: np.ndarray) -> np.ndarray:
        """Curvature (k,) [1/m] at arc lengths (k,) [m] under inputs (n_inputs,) [N]."""
        reached = np.less.outer(stations, self._ends)
        return (reached * self._sides) @ reduced

    def tip(self, reduced: np.ndarray) -> np.ndarray:
        """Tip (2,) [m] in (x, z) under reduced inputs (n_inputs,) [N]."""
        z = self._weights @ np.exp(1j * (self._slope @ reduced))
        return np.array([z.imag, z.real])

    def jacobian(self, reduced: np.ndarray) -> np.ndarray:
        """Derivative (2, n_inputs) [m/N] of the tip."""
        return self.expand(reduced)[1]

    def expand(self, reduced: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
