"""Design of the LQ tracking law with reference preview at an operating point."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from softrobot_env.beams.closed_forms.planar_arm import PlanarArm
from softrobot_env.control.arm.lqi import linear_model

#: Times [s] ahead at which the reference is used; straight lines in between.
KNOTS = (0.001, 0.002, 0.004, 0.007, 0.011, 0.016, 0.023, 0.032, 0.045, 0.06, 0.08, 0.105, 0.15)


@dataclass(frozen=True)
class Weights:
    """Weights of the cost sum_k (|e|^2 + velocity |e.|^2 + inputs |u|^2).

    e is the tip's distance [m] from the reference, u the inputs' [N] from those that hold it.

    Attributes:
        velocity: [s2].
        inputs: [m2/N2].
    """

    velocity: float = 1e-3
    inputs: float = 3e-7


def discretized(a: np.ndarray, b: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact A (n, n) and B (n, m) over a period [s] with constant inputs."""
    n, m = b.shape
    both = expm(period * np.block([[a, b], [np.zeros((m, n + m))]]))
    return both[:n, :n], both[:n, n:]


def preview_design(
    arm: PlanarArm, curvature: np.ndarray, period: float, weights: Weights
) -> np.ndarray:
    """Gains of u = -K x + sum_i G_i r_i, flattened to (n_inputs * (2 n + 2 * knots),).

    x = (curvatures, rates) and r_i, the reference at the i-th knot, are deviations from an
    operating point. The optimum for a known reference: with P from Riccati's equation,
    W = (R + B'PB)^-1, and A_c = A - BK, the reference j steps ahead enters through W B' A_c'^(j-1).
    Beyond the last knot it is taken to stay there.

    Args:
        arm: The arm.
        curvature: (n,) [1/m] of the operating point.
        period: [s] between decisions.
        weights: Of the cost.
    """
    continuous_a, continuous_b, position = linear_model(arm, curvature)
    a, b = discretized(continuous_a, continuous_b, period)
    speed = np.roll(position, arm.n, axis=1)
    state_weight = position.T @ position + weights.velocity * speed.T @ speed
    # Riccati's equation needs every state in the cost; this is far below the rest.
    state_weight += 1e-12 * np.eye(len(a))
    m = b.shape[1]
    riccati = solve_discrete_are(a, b, state_weight, weights.inputs * np.eye(m))
    gain = np.linalg.solve(weights.inputs * np.eye(m) + b.T @ riccati @ b, b.T)
    feedback = gain @ riccati @ a
    closed = a - b @ feedback
    steps = round(KNOTS[-1] / period)
    per_step = np.zeros((m, 2, steps + 1))
    for j in range(1, steps + 1):
        per_step[:, :, j] += gain @ position.T
        by_speed = weights.velocity * gain @ speed.T / (2 * period)
        if j < steps:
            per_step[:, :, j + 1] += by_speed
            per_step[:, :, j - 1] -= by_speed
        gain = gain @ closed.T
    rest = np.linalg.solve(np.eye(len(a)) - closed, gain.T).T
    per_step[:, :, -1] += rest @ position.T
    preview = per_step @ _hats(steps, period)
    return np.concatenate([feedback, preview.transpose(0, 2, 1).reshape(m, -1)], axis=1).ravel()


def _hats(steps: int, period: float) -> np.ndarray:
    """Weights (steps + 1, knots) with which the reference at every step follows from the knots.

    The present reference, from which the others deviate, has none.
    """
    times = period * np.arange(steps + 1)
    points = np.concatenate(([0.0], KNOTS))
    return np.stack([np.interp(times, points, row) for row in np.eye(len(points))[1:]], axis=1)
