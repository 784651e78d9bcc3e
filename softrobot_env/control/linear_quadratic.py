"""Parts of linear-quadratic laws: exact discretisation, and how a coming reference enters."""

import numpy as np
from scipy.linalg import expm


def discretized(a: np.ndarray, b: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact A (n, n) and B (n, m) over a period [s] with constant inputs."""
    n, m = b.shape
    both = expm(period * np.block([[a, b], [np.zeros((m, n + m))]]))
    return both[:n, :n], both[:n, n:]


def preview_gains(
    closed: np.ndarray,
    gain: np.ndarray,
    position: np.ndarray,
    speed: np.ndarray,
    velocity_weight: float,
    knots: tuple[float, ...],
    period: float,
) -> np.ndarray:
    """Gains (m, k, d) of references at some times ahead, straight lines in between.

    The optimum for a known reference of an LQ regulator: with P from Riccati's equation,
    W = (R + B'PB)^-1 and A_c = A - BK, the reference j steps ahead enters through W B' A_c'^(j-1).
    Beyond the last knot it is taken to stay there.

    Args:
        closed: A_c (n, n).
        gain: W B' (m, n).
        position: (d, n), the outputs of the state that follow the reference.
        speed: (d, n), their rates [1/s].
        velocity_weight: [s2], of errors of the rate over those of the output.
        knots: (k,) [s], times ahead.
        period: [s] of a step.
    """
    steps = round(knots[-1] / period)
    per_step = np.zeros((len(gain), len(position), steps + 1))
    states = np.eye(len(closed))
    for j in range(1, steps + 1):
        per_step[:, :, j] += gain @ position.T
        by_speed = velocity_weight * gain @ speed.T / (2 * period)
        if j < steps:
            per_step[:, :, j + 1] += by_speed
            per_step[:, :, j - 1] -= by_speed
        gain = gain @ closed.T
    rest = np.linalg.solve(states - closed, gain.T).T
    per_step[:, :, -1] += rest @ position.T
    return (per_step @ hats(steps, knots, period)).transpose(0, 2, 1)


def hats(steps: int, knots: tuple[float, ...], period: float) -> np.ndarray:
    """Weights (steps + 1, knots) with which the reference at every step follows from the knots.

    The present reference, from which the others deviate, has none.
    """
    times = period * np.arange(steps + 1)
    points = np.concatenate(([0.0], knots))
    return np.stack([np.interp(times, points, row) for row in np.eye(len(points))[1:]], axis=1)
