"""The rig as a rod that only bends, by Ritz' method: a truth that no model of the package shares.

The curvatures beta (towards +x) and gamma (towards +y) are polynomials of the arc length, with
coefficients q = (q_beta, q_gamma) [rad] of Legendre polynomials over the length L; the first ones
are the bending angles of the whole rod. Sections follow by spectral integration: with S the matrix
that integrates the polynomial through values at Gauss points from 0 to each of them and to L,

    R = 1 + S (R kappa^),   r = S R e_3,   d omega/dq_i = S (R axis_i P_i / L),   and so on.

So errors fall exponentially with the number of terms. The rod does not twist, shear or stretch;
it carries the head, and channels at constant offsets hold the tendons.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp

from softrobot_env.robots import RobotParams
from studies.truths.rig_column import tensions
from studies.truths.shooting import grown

#: Lengths (3,) [m] pulled in at time t [s].
Pulled = Callable[[float], ndarray]

_NODES = 16
_RTOL, _ATOL = 1e-8, 1e-10
_RESIDUAL = 1e-12  # N m


class Shape(NamedTuple):
    """A posture at the K nodes and the end; n coordinates.

    Attributes:
        frame: (K + 1, 3, 3), columns are the directors.
        place: (K + 1, 3) [m].
        bends: (K, n, 3) [1/m], change of the curvature vector by the coordinates.
        turns: (K + 1, n, 3), of the orientation.
        moves: (K + 1, n, 3) [m], of the place.
    """

    frame: ndarray
    place: ndarray
    bends: ndarray
    turns: ndarray
    moves: ndarray


class RigRod:
    """The rod.

    Args:
        robot: A robot with a head and tendons in channels of its whole length.
        terms: Polynomials for each of the two curvatures; one is a piece of constant curvature.
    """

    def __init__(self, robot: RobotParams, terms: int = 6) -> None:
        self.robot, self.terms = robot, terms
        x, weights = legendre.leggauss(_NODES)
        self.weights = robot.length / 2 * weights
        self.basis = legendre.legvander(x, terms - 1) / robot.length
        antiderivative = np.stack([_integral(k, x) for k in range(_NODES)], axis=1)
        to_legendre = np.linalg.inv(legendre.legvander(x, _NODES - 1))
        self.integrate = robot.length / 2 * antiderivative @ to_legendre
        gram = self.basis.T @ (self.weights[:, None] * self.basis)
        self.elastic = np.kron(np.eye(2), robot.bending_stiffness * gram)

    def shape(self, q: ndarray) -> Shape:
        """Posture for coordinates (2 terms,)."""
        beta, gamma = q.reshape(2, -1) @ self.basis.T
        frame = self._frames(_spin(np.stack([-gamma, beta, 0 * beta], axis=1)))
        place = self._up_to(frame[:-1, :, 2])
        toward_x, toward_y = frame[:-1, None, :, 1], -frame[:-1, None, :, 0]
        basis = self.basis[:, :, None]
        bends = np.concatenate([basis * toward_x, basis * toward_y], axis=1)
        turns = self._up_to(bends)
        moves = self._up_to(np.cross(turns[:-1], frame[:-1, None, :, 2]))
        return Shape(frame, place, bends, turns, moves)

    def _up_to(self, values: ndarray) -> ndarray:
        """Integrals (K + 1, ...) from the base to the nodes and the end."""
        return np.tensordot(self.integrate, values, 1)

    def _frames(self, spin: ndarray) -> ndarray:
        """Frames (K + 1, 3, 3) with R' = R spin, R = 1 at the base, for spin (K, 3, 3)."""
        k = len(spin)
        system = np.eye(3 * k) - np.einsum(
            "ij,jba->iajb", self.integrate[:-1], spin, optimize=True
        ).reshape(3 * k, 3 * k)
        rows = np.linalg.solve(system, np.tile(np.eye(3), (k, 1)))
        inner = rows.reshape(k, 3, 3).transpose(0, 2, 1)
        end = np.eye(3) + np.einsum("j,jab->ab", self.weights, inner @ spin)
        return np.concatenate([inner, end[None]])

    def tip(self, q: ndarray) -> ndarray:
        """Output point (3,) [m]."""
        shape = self.shape(q)
        return shape.place[-1] + self.robot.head.output * shape.frame[-1, :, 2]

    def tension(self, q: ndarray, pulled: ndarray) -> ndarray:
        """Tensions (3,) [N] when lengths (3,) [m] are pulled in; the whole bend is q's first."""
        return tensions(self.robot, pulled, q[:: self.terms])

    def static_force(self, q: ndarray, pulled: ndarray, shape: Shape) -> ndarray:
        """Generalised force (n,) [N m] of elasticity, weight and tendons."""
        robot, head = self.robot, self.robot.head
        out = -self.elastic @ q
        out[:: self.terms] += self.tension(q, pulled) @ [t.offset for t in robot.tendons]
        line = robot.mass_per_length * np.einsum("k,kia->ia", self.weights, shape.moves[:-1])
        return out + (line + head.mass * self._head_moves(shape)) @ np.array(robot.gravity)

    def _head_moves(self, shape: Shape) -> ndarray:
        """Change (n, 3) [m] of the centre of the head by the coordinates."""
        up = self.robot.head.centre * shape.frame[-1, :, 2]
        return shape.moves[-1] + np.cross(shape.turns[-1], up)

    def equilibrium(self, pulled: ndarray) -> ndarray:
        """Coordinates (n,) at rest with lengths (3,) [m] pulled in, reached from the straight rod.

        Raises:
            EquilibriumError: None was found.
        """
        lengths = np.asarray(pulled)

        def missing(q: ndarray, share: float) -> ndarray:
            return self.static_force(q, share * lengths, self.shape(q))

        at, limits = f"the rod at {pulled} m", {"most": _RESIDUAL, "tol": 1e-13}
        return grown(missing, np.zeros(2 * self.terms), at, **limits)

    def acceleration(self, q: ndarray, v: ndarray, pulled: ndarray) -> ndarray:
        """(n,) [rad/s2] in state q, v (n,) with lengths (3,) [m] pulled in."""
        shape = self.shape(q)
        mass, bias = self._inertia(shape, v)
        damping = self.robot.damping_time * self.elastic @ v
        return np.linalg.solve(mass, self.static_force(q, pulled, shape) - damping - bias)

    def _inertia(self, shape: Shape, v: ndarray) -> tuple[ndarray, ndarray]:
        """Mass matrix (n, n) [kg m2], and forces (n,) [N m] of inertia at constant rates v."""
        robot, head, axis = self.robot, self.robot.head, shape.frame[..., 2]
        spin = np.einsum("kia,i->ka", shape.turns, v)
        turning = self._up_to(np.cross(spin[:-1], np.einsum("kia,i->ka", shape.bends, v)))
        rise = np.cross(turning, axis) + np.cross(spin, np.cross(spin, axis))
        moving = self._up_to(rise[:-1])
        weights = np.append(self.weights, 1.0)
        masses = weights * robot.mass_per_length
        moments = robot.density * robot.second_moment * np.array([1.0, 1.0, 2.0])
        inertia = np.einsum("k,kab,b,kcb->kac", weights, shape.frame, moments, shape.frame)
        masses[-1] = head.mass
        inertia[-1] = shape.frame[-1] @ np.diag(head.inertia) @ shape.frame[-1].T
        moves = shape.moves.copy()
        moves[-1] = self._head_moves(shape)
        moving[-1] += head.centre * rise[-1]
        heavy = masses[:, None, None] * moves
        rolled = shape.turns @ inertia
        mass = np.einsum("kia,kja->ij", heavy, moves)
        mass += np.einsum("kia,kja->ij", rolled, shape.turns)
        momentum = np.einsum("kab,kb->ka", inertia, spin)
        bias = np.einsum("kia,ka->i", heavy, moving) + np.einsum("kia,ka->i", rolled, turning)
        return mass, bias + np.einsum("kia,ka->i", shape.turns, np.cross(spin, momentum))

    def motion(self, pulled: Pulled, times: ndarray, rtol: float = _RTOL) -> ndarray:
        """Output points (k, 3) [m] at instants (k,) [s], from the equilibrium at the first one.

        Args:
            pulled: Lengths (3,) [m] over time.
            times: Instants, increasing from zero.
            rtol: Relative tolerance of the integration by Radau's method.

        Raises:
            RuntimeError: The integration failed.
        """
        n = 2 * self.terms

        def slope(t: float, y: ndarray) -> ndarray:
            return np.concatenate([y[n:], self.acceleration(y[:n], y[n:], pulled(t))])

        start = np.concatenate([self.equilibrium(np.zeros(3)), np.zeros(n)])
        atol = _ATOL * rtol / _RTOL
        found = solve_ivp(slope, (0, times[-1]), start, "Radau", times, rtol=rtol, atol=atol)
        if not found.success:
            raise RuntimeError(f"the rod's motion failed: {found.message}")
        return np.array([self.tip(q) for q in found.y[:n].T])


def _integral(k: int, x: ndarray) -> ndarray:
    """Integrals (K + 1,) of the k-th Legendre polynomial from -1 to x (K,) and to 1."""
    series = legendre.legint(np.eye(k + 1)[k], lbnd=-1)
    return legendre.legval(np.append(x, 1.0), series)


def _spin(vectors: ndarray) -> ndarray:
    """Matrices (k, 3, 3) of the cross products with vectors (k, 3)."""
    x, y, z = vectors.T
    zero = 0 * x
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.array(rows).transpose(2, 0, 1)
