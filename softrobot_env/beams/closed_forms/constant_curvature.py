"""Statics of a planar tendon arm without gravity: constant curvature between tendon ends.

With continuous routing the tendon moment is constant between the stations where tendons end, so
the exact equilibrium of an inextensible, shear-free beam is piecewise constant in curvature
(audit of sec. 6.2.2: beta = sum F_k r_k / EI over the pairs that reach the piece). The tangent
angle phi(s) is then linear in the reduced inputs u, and tip and derivatives are integrals of
exp(i phi(s)), smooth through the straight pose.
"""

from dataclasses import dataclass

import numpy as np

from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap

_NODES = 16
_TOLERANCE = 1e-8  # m
_NULL_TOLERANCE = 1e-7  # N
_ITERATIONS = 60


@dataclass(frozen=True)
class InverseStatics:
    """Outcome of `ConstantCurvatureStatics.inverse`.

    Attributes:
        reduced: (n_inputs,) [N], reduced tendon inputs.
        residual: [m], distance between the target and the tip these inputs hold.
        converged: Whether the tip is on the target at a local minimum of the tension norm.
    """

    reduced: np.ndarray
    residual: float
    converged: bool


class ConstantCurvatureStatics:
    """Tip (x, z) as a function of the reduced tendon inputs, its derivatives and its inverse."""

    def __init__(self, robot: RobotParams) -> None:
        """Raise ValueError when the robot has gravity, guides or no tendons."""
        if not robot.tendons or any(robot.gravity) or any(t.guides for t in robot.tendons):
            raise ValueError(
                f"robot {robot.name!r}: constant-curvature statics need tendons in continuous "
                "channels and no gravity"
            )
        self.robot = robot
        tendon_map = TendonMap(robot)
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
        return self._expand(reduced)[1]

    def _expand(self, reduced: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tip (2,), first (2, n) and second (2, n, n) derivatives."""
        e = self._weights * np.exp(1j * (self._slope @ reduced))
        first = 1j * (e @ self._slope)
        second = -(self._slope.T * e) @ self._slope
        tip = e.sum()
        return (
            np.array([tip.imag, tip.real]),
            np.stack([first.imag, first.real]),
            np.stack([second.imag, second.real]),
        )

    def inverse(self, target: np.ndarray, guess: np.ndarray) -> InverseStatics:
        """Inputs of least norm that hold the tip on a target, near a guess.

        Minimises |u|^2 / 2 subject to tip(u) = target by a range- and null-space Newton
        method with step control; the redundancy of the arm is resolved by minimum tension.

        Args:
            target: (2,) [m], (x, z).
            guess: (n_inputs,) [N], start; the nearest local minimum is found.

        Returns:
            The inputs. `converged` is False where the target cannot be reached from the guess;
            the inputs are then those of the smallest residual met.
        """
        u = np.array(guess, dtype=float)
        best, best_residual = u, np.inf
        for _ in range(_ITERATIONS):
            tip, first, second = self._expand(u)
            gap = np.asarray(target) - tip
            residual = float(np.hypot(*gap))
            if residual < best_residual:
                best, best_residual = u, residual
            to_range, to_null = _newton_steps(u, gap, first, second)
            if residual < _TOLERANCE and np.max(np.abs(to_null)) < _NULL_TOLERANCE:
                return InverseStatics(u, residual, True)
            u = u + _shorten(to_range, self.limit) + _shorten(to_null, self.limit)
        return InverseStatics(best, best_residual, False)


def _newton_steps(
    u: np.ndarray, gap: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Step towards the target in the row space of J, and down |u|^2 in its null space."""
    left, singular, right = np.linalg.svd(first)
    # Near the straight pose J loses rank; the damping bounds the step there and vanishes with
    # the gap, so it does not disturb convergence.
    damping = 1e-3 * np.hypot(*gap) * singular[0]
    gain = singular / (singular**2 + damping)
    range_, null = right[: len(singular)].T, right[len(singular) :].T
    to_range = range_ @ (gain * (left.T @ gap))
    multiplier = -left @ (gain * (range_.T @ u))
    bend = np.eye(len(u)) + multiplier[0] * second[0] + multiplier[1] * second[1]
    hessian = null.T @ bend @ null
    values, vectors = np.linalg.eigh(hessian)
    slope = vectors.T @ (null.T @ u)
    return to_range, -null @ (vectors @ (slope / np.maximum(np.abs(values), 0.1)))


def _shorten(step: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """The step, scaled down to at most a tenth of the tension limit."""
    return step / max(1.0, np.max(np.abs(step) / (0.1 * limit)))
